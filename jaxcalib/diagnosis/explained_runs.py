"""Runs that contain an effect, at parameter values of their own: made by SUMO where it can, by the surrogate else."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.altered_drives import ALTERATIONS
from jaxcalib.diagnosis.atlas import BASELINE, parameter_steps
from jaxcalib.diagnosis.evidence import Signature
from jaxcalib.diagnosis.features import DriveTallies
from jaxcalib.diagnosis.noise import NullModel, on_cells
from jaxcalib.diagnosis.sumo_runs import SumoRuns
from jaxcalib.diagnosis.trials import Trial, paired_difference
from jaxcalib.diagnosis.windows import window_of
from jaxcalib.problem import CalibrationProblem
from sim_adapters.sumo_effects import is_expressible
from surrogate.effects.base import EffectSetting

LEAST_VALUE_SHARE = 0.3  # of a calibrated value


@dataclass(frozen=True)
class ExplainedRuns:
    """Runs that contain an effect.

    Attributes:
        with_effect: their tallies.
        without: tallies of runs with the same seeds in the same simulator, with the calibrated values and no effect,
            where the simulator is the surrogate: only the difference counts. None where SUMO made the runs.
    """

    with_effect: DriveTallies
    without: DriveTallies | None = None

    def difference(self, null: NullModel) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much features differ from the null's, in units of noise, and the standard error.

        Features that these runs do not show count as unchanged.
        """
        if self.without is not None:
            shift, error, _ = paired_difference(self.with_effect, self.without, null.cells)
            return shift / null.deviation, np.where(np.isfinite(error), error, 0.0) / null.deviation
        seen = on_cells(self.with_effect, null.cells)
        shift = null.standardised(seen.values())
        error = np.nan_to_num(seen.influence()).std(axis=0, ddof=1) / np.sqrt(len(seen)) / null.deviation
        is_known = np.isfinite(shift) & (seen.below.sum(axis=0) > 0)
        return np.where(is_known, shift, 0.0), np.where(is_known, error, 0.0)


@dataclass(frozen=True)
class ExplainedRunner:
    """Makes runs that contain an effect.

    Attributes:
        problem: the problem.
        values: calibrated values.
        in_sumo: SUMO's runs.
        in_surrogate: makes a trial in the surrogate; the baseline's tallies are among what it returns.
        num_runs: of each trial in the surrogate.
    """

    problem: CalibrationProblem
    values: np.ndarray
    in_sumo: SumoRuns
    in_surrogate: Callable[[Trial], Mapping[str, DriveTallies]]
    num_runs: int

    def run(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        """Return runs with an effect; None where SUMO's fail.

        Args:
            signature: of the effect; it tells name, sign, place and time.
            steps: shift of the parameters from the calibrated values, in steps.
            strength: size of the effect's strength.
        """
        values = moved_values(self.values, parameter_steps(self.problem.layout, self.values), steps)
        name, signed = signature.effect, signature.sign * strength
        if name in ALTERATIONS or is_expressible(self.problem.scenario, name):
            tallies = self.in_sumo.explained(name, signed, values)
            return None if tallies is None else ExplainedRuns(tallies)
        window = window_of(signature)
        setting = EffectSetting(signed) if window is None else window.effect_setting(signed)
        trial = Trial(f"{name} {setting!r} {values.tolist()!r}", tuple(values.tolist()), self.num_runs, {name: setting})
        found = self.in_surrogate(trial)
        return ExplainedRuns(found[trial.name], found[BASELINE])


def moved_values(values: np.ndarray, step_sizes: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return parameter values after a shift; none falls below a share of what was calibrated."""
    return np.maximum(values + step_sizes * steps, LEAST_VALUE_SHARE * values)
