"""Whether the surrogate ranks parameter sets, and answers to each parameter, as SUMO does.

All cases of an orthogonal array run in both simulators, on the same departures; SUMO's runs have the first of the
surrogate's seeds. The surrogate runs more often, which costs little: what is left of its own noise would pass for its
error. What depends on single steps is left out, as in a calibration (`jaxcalib.calibration.objective.moments`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import spearmanr

from jaxcalib.calibration.objective.moments import FEWEST_OBSERVATIONS, Moments, all_moments
from jaxcalib.calibration.stages.evaluator import Evaluations, Evaluator
from jaxcalib.problem.engines import sumo_engine, surrogate_engine
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.search.orthogonal_arrays.orthogonal_array import OrthogonalArray, orthogonal_array

INPUT_SPREAD = 0.2
SPARE_CAPACITY = 3.0  # some cases are jammed
NUM_LEVELS, NUM_CASES = 4, 64
SURROGATE_RUNS_PER_SUMO_RUN = 4  # its standard errors are halved; a run takes a sixtieth of SUMO's time
NOISE_FACTOR = 3.0  # a measure, or an effect, counts if it exceeds its noise so many times
# equidistant levels of calibration studies of SUMO and VISSIM
LEVELS: dict[str, tuple[float, float]] = {
    "tau": (0.6, 2.1), "minGap": (1.0, 3.0), "accel": (0.7, 2.2), "decel": (1.5, 4.0), "delta": (2.0, 8.0),
    "sigma": (0.0, 0.6), "cc1": (0.6, 1.8), "cc2": (2.0, 11.0), "cc3": (-14.0, -5.0), "cc4": (-1.5, -0.15),
    "cc5": (0.15, 1.5), "cc6": (2.0, 20.0), "cc7": (0.1, 0.7), "cc8": (1.5, 4.0), "cc9": (0.5, 2.0),
    "speedFactor": (0.75, 1.05), "speedDev": (0.04, 0.16), "lcAssertive": (0.7, 2.5), "lcSpeedGain": (0.3, 3.0),
    "lcSpeedGainRight": (0.1, 1.0), "lcCooperative": (0.1, 1.0), "lcCooperativeSpeed": (0.1, 1.0),
    "lcStrategic": (0.5, 5.0), "lcKeepRight": (0.0, 1.5), "lcSpeedGainRemainTime": (5.0, 30.0),
    "lcLookaheadLeft": (1.0, 4.0),
}  # fmt: skip


@dataclass(frozen=True)
class MeasureTransfer:
    """One measure in both simulators."""

    measure: str  # its name
    spread_in_noise: float  # standard deviation over cases in SUMO, in standard errors of a case
    rank_correlation: float  # Spearman's, over cases
    bias: float  # median of surrogate / SUMO - 1


@dataclass(frozen=True)
class EffectTransfer:
    """The main effect of one parameter on one measure, from lowest to highest level."""

    parameter: str  # its name
    measure: str  # name of the measure
    sumo: float  # effect in SUMO
    sumo_error: float  # its standard error
    surrogate: float  # effect in the surrogate

    @property
    def counts(self) -> bool:
        """Whether SUMO's effect exceeds its noise."""
        return abs(self.sumo) > NOISE_FACTOR * self.sumo_error

    @property
    def ratio(self) -> float:
        """Size of the surrogate's effect over SUMO's; negative where the sign is wrong."""
        return self.surrogate / self.sumo


@dataclass(frozen=True)
class Transfer:
    """What the cases show."""

    measures: tuple[MeasureTransfer, ...]  # of which SUMO's range exceeds its noise
    effects: tuple[EffectTransfer, ...]  # all effects on these measures
    num_failed: tuple[int, int]  # cases that failed in the surrogate and in SUMO


def cases_of(problem: CalibrationProblem) -> tuple[OrthogonalArray, Float[np.ndarray, "case parameter"]]:
    """Return the array and the parameter values of its cases."""
    names = problem.layout.names
    array = orthogonal_array(len(names), NUM_LEVELS, NUM_CASES)
    base = problem.template.base_values()
    spread = {
        name: ((1.0 - INPUT_SPREAD) * value, (1.0 + INPUT_SPREAD) * value)
        for name, value in zip(problem.layout.input_ids, base, strict=False)
    }
    low, high = np.asarray([(spread | LEVELS)[name] for name in names]).T
    return array, round_values(low + (high - low) * array.levels / (NUM_LEVELS - 1))


def run_cases(
    problem: CalibrationProblem,
    values: Float[np.ndarray, "case parameter"],
    num_runs: int,
    on_case: Callable[[], None],
) -> tuple[Evaluations, Evaluations]:
    """Run all cases in SUMO, at least as often as asked, and four times as often in the surrogate."""
    starts = problem.drive_starts("fit")
    surrogate = Evaluator(surrogate_engine(problem, SPARE_CAPACITY), starts, 0)
    one_round = surrogate.rounds_of(1)
    num_runs = math.ceil(num_runs / one_round) * one_round  # each drive equally often
    ours = surrogate.evaluate(values, SURROGATE_RUNS_PER_SUMO_RUN * num_runs)
    with sumo_engine(problem) as sumo:
        evaluator = Evaluator(sumo, starts, 0)
        parts = []
        for row in values:
            parts.append(evaluator.evaluate(row[None], num_runs))
            on_case()
    theirs = Evaluations(
        np.concatenate([part.tally for part in parts]),
        np.concatenate([part.is_ok for part in parts]),
        tuple(part.outcomes[0] for part in parts),
    )
    return ours, theirs


def transfer_of(
    problem: CalibrationProblem, array: OrthogonalArray, ours: Evaluations, theirs: Evaluations
) -> Transfer:
    """Compare the measures of both simulators over the cases that succeeded in both."""
    is_ok = ours.is_ok & theirs.is_ok
    moments = _observed(all_moments(problem.measures, problem.tally_index), theirs.tally[is_ok])
    surrogate, sumo = moments.values(ours.pooled[is_ok]), moments.values(theirs.pooled[is_ok])
    error = np.stack([_error(moments, tally) for tally in theirs.tally[is_ok]])
    noise = np.sqrt(np.nanmean(error**2, axis=0))
    spread = np.nanstd(sumo, axis=0) / noise
    measures, effects = [], []
    centred = array.levels[is_ok] / (array.num_levels - 1.0) - 0.5
    for number, name in enumerate(moments.names):
        known = np.isfinite(surrogate[:, number]) & np.isfinite(sumo[:, number])
        if spread[number] < NOISE_FACTOR or known.sum() < NUM_CASES // 2:
            continue
        x, y = surrogate[known, number], sumo[known, number]
        with np.errstate(divide="ignore", invalid="ignore"):
            bias = float(np.nanmedian(np.where(y != 0.0, x / y - 1.0, np.nan)))
        rank = float(np.asarray(spearmanr(x, y))[0])
        measures.append(MeasureTransfer(name, float(spread[number]), rank, bias))
        (of_sumo, sumo_error), (of_surrogate, _) = _effects(centred[known], y), _effects(centred[known], x)
        for parameter, one, its_error, other in zip(
            problem.layout.names, of_sumo, sumo_error, of_surrogate, strict=True
        ):
            effects.append(EffectTransfer(parameter, name, float(one), float(its_error), float(other)))
    return Transfer(tuple(measures), tuple(effects), (int((~ours.is_ok).sum()), int((~theirs.is_ok).sum())))


def _observed(moments: Moments, tally: Float[np.ndarray, "case run tally"]) -> Moments:
    """Return the moments that a typical case observes often enough."""
    total = np.nansum(tally, axis=1)
    is_per_drive = moments.denominator == moments.drives
    seen = np.where(is_per_drive, total[:, moments.numerator], total[:, moments.denominator])
    return moments.take(np.median(seen, axis=0) >= FEWEST_OBSERVATIONS)


def _error(moments: Moments, tally: Float[np.ndarray, "run tally"]) -> Float[np.ndarray, " moment"]:
    runs = tally[np.isfinite(tally).all(axis=1)]
    with np.errstate(divide="ignore", invalid="ignore"):
        return moments.influence(runs).std(axis=0, ddof=1) / np.sqrt(len(runs))


def _effects(centred: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return linear main effects and their standard errors, which hold noise and all that is not linear."""
    design = np.hstack([np.ones((len(values), 1)), centred])
    coefficients, *_ = np.linalg.lstsq(design, values, rcond=None)
    free = len(values) - design.shape[1]
    variance = np.sum((values - design @ coefficients) ** 2) / max(free, 1)
    return coefficients[1:], np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))[1:]
