"""Runs that contain an effect, at parameter values of their own: made by SUMO where it can, by the surrogate else."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, on_cells
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import window_of
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.diagnosis.runs.sumo_runs import SumoRuns
from jaxcalib.diagnosis.runs.trials import BASELINE, Trial, has_pairs, paired_difference
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.scenario.sumo_effects import is_expressible
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import effect_named

LARGEST_FALL = 0.7  # of a calibrated value's size
SLOPE_SHARE = 0.5  # of the runs of a point: slopes only say where to go on
FEWEST_SLOPE_RUNS = 8
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
        """Difference of the features from the null's, in units of noise, and its standard error.

        Features that these runs do not show count as unchanged, with an infinite error.
        """
        if self.without is not None:
            shift, error, _ = paired_difference(self.with_effect, self.without, null.cells)
            return shift / null.deviation, error / null.deviation
        seen = on_cells(self.with_effect, null.cells)
        shift = null.standardised(seen.values())
        error = self.deviation(null, seen.num_independent)
        is_known = np.isfinite(shift) & (seen.below.sum(axis=0) > 0)
        return np.where(is_known, shift, 0.0), np.where(is_known, error, np.inf)

    def deviation(self, null: NullModel, num_drives: float) -> np.ndarray:
        """Return the deviation of the features of so many drives with the effect, in units of the null's noise."""
        seen = on_cells(self.with_effect, null.cells)
        runs = seen.below.sum(axis=1) > 0
        spread = np.nan_to_num(seen.influence()[runs]).std(axis=0, ddof=1)
        return spread / np.sqrt(num_drives) / null.deviation


@dataclass(frozen=True)
class ExplainedRunner:
    """Makes runs that contain an effect.

    A signature tells its name, sign, place and time; steps are the shift of the parameters from the calibrated values,
    and a strength is a size.
    """

    problem: CalibrationProblem
    values: np.ndarray  # calibrated values
    sumo: SumoRuns  # makes SUMO's runs
    null: NullModel  # the null model for the drives to fit
    # makes trials in the surrogate; the baseline's tallies are among what it returns
    run_trials: Callable[[Sequence[Trial]], Mapping[str, DriveTallies]]
    num_runs: int  # of each trial in the surrogate

    def in_surrogate(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        """Return the surrogate's runs with an effect; None where they fail, or do not show it."""
        if effect_named(signature.effect).is_sensor_s:
            return None
        trial = self._trial(signature, moved_values(self.values, self._step_sizes, steps), strength)
        tallies = self.run_trials([trial])
        made = ExplainedRuns(tallies[trial.name], tallies[BASELINE])
        return made if has_pairs(tallies[trial.name], tallies[BASELINE]) else None

    def in_sumo(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        """Return SUMO's runs with an effect; None where they fail, or where it has no means for the effect."""
        is_sensor_s = effect_named(signature.effect).is_sensor_s
        if not is_sensor_s and not is_expressible(self.problem.scenario, signature.effect):
            return None
        values = moved_values(self.values, self._step_sizes, steps)
        tallies = self.sumo.explained(signature.effect, signature.sign * strength, values)
        return None if tallies is None else ExplainedRuns(tallies)

    def slopes(self, signature: Signature, steps: np.ndarray, strength: float, known: np.ndarray) -> np.ndarray:
        """Change of the features with each parameter's step and with the strength, once the effect is in.

        [feature, parameter and strength], in units of noise. What the surrogate does not show stays as known; a
        sensor's effect leaves traffic as it is, so that all that is known of the parameters holds.
        """
        if effect_named(signature.effect).is_sensor_s:
            return known
        values = moved_values(self.values, self._step_sizes, steps)
        here = self._trial(signature, values, strength)
        moved = [values + self._step_sizes * (np.arange(len(values)) == number) for number in range(len(values))]
        away = [self._trial(signature, there, strength, SLOPE_SHARE) for there in moved]
        widths = [1.0] * len(away)
        if not signature.is_fixed:
            away.append(self._trial(signature, values, (1.0 - STRENGTH_DROP) * strength, SLOPE_SHARE))
            widths.append(-STRENGTH_DROP * strength)
        tallies = self.run_trials([here, *away])
        slopes = known.copy()
        for column, (trial, width) in enumerate(zip(away, widths, strict=True)):
            difference, error, _ = paired_difference(tallies[trial.name], tallies[here.name], self.null.cells)
            is_shown = np.isfinite(error)
            slopes[is_shown, column] = (difference / self.null.deviation)[is_shown] / width
        return slopes

    @property
    def _step_sizes(self) -> np.ndarray:
        return parameter_steps(self.problem.layout, self.values)

    def _trial(self, signature: Signature, values: np.ndarray, strength: float, share: float = 1.0) -> Trial:
        setting = _setting(signature, strength)
        told = tuple(float(value) for value in values)
        num_runs = max(FEWEST_SLOPE_RUNS, round(share * self.num_runs))
        name = f"{signature.effect} {setting!r} {told!r} x{num_runs}"
        return Trial(name, told, num_runs, {signature.effect: setting})


def _setting(signature: Signature, strength: float) -> EffectSetting:
    window, signed = window_of(signature), signature.sign * strength
    return EffectSetting(signed) if window is None else window.effect_setting(signed)


def moved_values(values: np.ndarray, step_sizes: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return parameter values after a shift; none falls below `least_values`."""
    return round_values(np.maximum(values + step_sizes * steps, least_values(values)))


def least_values(values: np.ndarray) -> np.ndarray:
    """Return how far parameter values may fall; some of SUMO's lane-change weights are negative to begin with."""
    return values - LARGEST_FALL * np.abs(values)
