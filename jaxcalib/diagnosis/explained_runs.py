"""Runs that contain an effect, at parameter values of their own: made by SUMO where it can, by the surrogate else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.altered_drives import ALTERATIONS
from jaxcalib.diagnosis.atlas import BASELINE, parameter_steps
from jaxcalib.diagnosis.evidence import Signature
from jaxcalib.diagnosis.features import DriveTallies
from jaxcalib.diagnosis.noise import NullModel, on_cells
from jaxcalib.diagnosis.sumo_runs import SumoRuns
from jaxcalib.diagnosis.trials import Trial, has_pairs, paired_difference
from jaxcalib.diagnosis.windows import window_of
from jaxcalib.problem import CalibrationProblem
from sim_adapters.sumo_effects import is_expressible
from surrogate.effects.base import EffectSetting

LEAST_VALUE_SHARE = 0.3  # of a calibrated value
STRENGTH_DROP = 0.3  # of the strength: over which the change with strength is measured; no stronger, shares end at 1


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
        null: the null model for the drives to fit.
        in_surrogate: makes trials in the surrogate; the baseline's tallies are among what it returns.
        num_runs: of each trial in the surrogate.
    """

    problem: CalibrationProblem
    values: np.ndarray
    in_sumo: SumoRuns
    null: NullModel
    in_surrogate: Callable[[Sequence[Trial]], Mapping[str, DriveTallies]]
    num_runs: int

    def run(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        """Return runs with an effect; None where they fail.

        Args:
            signature: of the effect; it tells name, sign, place and time.
            steps: shift of the parameters from the calibrated values, in steps.
            strength: size of the effect's strength.
        """
        values = moved_values(self.values, self._step_sizes, steps)
        name, signed = signature.effect, signature.sign * strength
        if name in ALTERATIONS or is_expressible(self.problem.scenario, name):
            tallies = self.in_sumo.explained(name, signed, values)
            return None if tallies is None else ExplainedRuns(tallies)
        trial = self._trial(signature, values, strength)
        found = self.in_surrogate([trial])
        made = ExplainedRuns(found[trial.name], found[BASELINE])
        return made if has_pairs(found[trial.name], found[BASELINE]) else None

    def slopes(self, signature: Signature, steps: np.ndarray, strength: float, known: np.ndarray) -> np.ndarray:
        """Return how features change with each parameter's step and with the strength, once the effect is in.

        A sensor's effect leaves traffic as it is, so that what is known of the parameters holds.

        Args:
            signature: of the effect.
            steps: shift of the parameters from the calibrated values, in steps.
            strength: size of the effect's strength.
            known: the same slopes as known so far, [feature, parameter and strength], in units of noise; for what the
                surrogate does not show.
        """
        if signature.effect in ALTERATIONS:
            return known
        values = moved_values(self.values, self._step_sizes, steps)
        pairs = []
        for place in range(len(values)):
            moved = [values + sign * self._step_sizes * (np.arange(len(values)) == place) for sign in (1.0, -1.0)]
            pairs.append([self._trial(signature, np.maximum(one, 1e-3), strength) for one in moved])
        if not signature.is_fixed:
            sizes = (strength, (1.0 - STRENGTH_DROP) * strength)
            pairs.append([self._trial(signature, values, size) for size in sizes])
        found = self.in_surrogate([trial for pair in pairs for trial in pair])
        slopes = known.copy()
        for place, (up, down) in enumerate(pairs):
            difference, error, _ = paired_difference(found[up.name], found[down.name], self.null.cells)
            width = 2.0 if place < len(values) else STRENGTH_DROP * strength
            is_shown = np.isfinite(error)
            slopes[is_shown, place] = (difference / self.null.deviation)[is_shown] / width
        return slopes

    @property
    def _step_sizes(self) -> np.ndarray:
        return parameter_steps(self.problem.layout, self.values)

    def _trial(self, signature: Signature, values: np.ndarray, strength: float) -> Trial:
        window, signed = window_of(signature), signature.sign * strength
        setting = EffectSetting(signed) if window is None else window.effect_setting(signed)
        told = tuple(float(one) for one in values)
        return Trial(f"{signature.effect} {setting!r} {told!r}", told, self.num_runs, {signature.effect: setting})


def moved_values(values: np.ndarray, step_sizes: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return parameter values after a shift; none falls below a share of what was calibrated."""
    return np.maximum(values + step_sizes * steps, LEAST_VALUE_SHARE * values)
