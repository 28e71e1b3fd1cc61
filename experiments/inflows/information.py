"""What drives hold about the inflows at best: the Cramér-Rao bound, by simulation at the truth.

The moments that a calibration matches are nearly normal, with a mean that depends on the inflows and a covariance that
single runs show. Their Fisher information about the inflows q is (dm/dq)' C^-1 (dm/dq) times the number of drives
(Kay 1993, Eq. 3.31, less the covariance's own slope); no unbiased estimate from these moments has a smaller covariance
than its inverse. What a calibration believes of the scenario's inflows adds to it (van Trees 1968). Drivers are taken
as known, which makes the bound smaller than anything that has to find them, too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.fidelity.transfer import SPARE_CAPACITY
from jaxcalib.calibration.objective.moments import Moments, all_moments, noise_covariance, observed_moments
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.initial_values.demand_profile import SCENARIO_TRUST, DemandEstimate, demand_covariance
from jaxcalib.problem.engines import surrogate_engine
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem

STEP = 0.08  # of an inflow, to each side
NOISE_RUNS, SLOPE_RUNS = 384, 192
SLOPE_SEEDS = 10_000  # from which the slopes' runs are numbered


@dataclass(frozen=True)
class Bound:
    """Least standard errors of the inflows."""

    names: tuple[str, ...]  # inputs
    relative: tuple[float, ...]  # standard error over the true inflow
    num_moments: int  # that were observed often enough


def inflow_bound(problem: CalibrationProblem, truth: Float[np.ndarray, " parameter"]) -> Bound:
    """Return the bound.

    Args:
        problem: whose drives to fit say how many there are and when they depart.
        truth: the field's parameter values.
    """
    starts = problem.drive_starts("fit")
    evaluator = Evaluator(surrogate_engine(problem, SPARE_CAPACITY, 0.0), starts, 0)
    noise = _successful(evaluator, truth, NOISE_RUNS, 0)
    field = problem.field_of("fit")
    moments = observed_moments(all_moments(problem.measures, problem.tally_index), field, noise)
    inverse = np.linalg.inv(noise_covariance(moments, noise, moments.values(field.sum(axis=0))))
    first, second = (_slopes(problem, evaluator, moments, truth, SLOPE_SEEDS * (1 + half)) for half in range(2))
    # slopes of two halves: their noise is no information
    information = 0.5 * (first.T @ inverse @ second + second.T @ inverse @ first) * len(starts)
    values, vectors = np.linalg.eigh(information)
    information = (vectors * np.maximum(values, 0.0)) @ vectors.T  # noise of slopes can make an eigenvalue negative
    one = np.ones(problem.layout.num_inputs)
    believed = np.linalg.inv(demand_covariance(DemandEstimate(one, one, one, SCENARIO_TRUST * one)))
    variance = np.diag(np.linalg.inv(information + believed))
    return Bound(problem.layout.input_ids, tuple(map(float, np.sqrt(variance))), len(moments.names))


def _slopes(
    problem: CalibrationProblem,
    evaluator: Evaluator,
    moments: Moments,
    truth: Float[np.ndarray, " parameter"],
    offset: int,
) -> Float[np.ndarray, "moment input"]:
    """Return the moments' changes per relative change of each inflow, on common random numbers."""
    slopes = []
    for number in range(problem.layout.num_inputs):
        sides = []
        for side in (1.0 + STEP, 1.0 - STEP):
            values = truth.copy()
            values[number] *= side
            sides.append(moments.values(_successful(evaluator, values, SLOPE_RUNS, offset).sum(axis=0)))
        slopes.append((sides[0] - sides[1]) / (2.0 * STEP))
    return np.stack(slopes, axis=1)


def _successful(
    evaluator: Evaluator, values: Float[np.ndarray, " parameter"], num_runs: int, offset: int
) -> Float[np.ndarray, "run tally"]:
    runs = evaluator.evaluate(round_values(values)[None], evaluator.rounds_of(num_runs), offset).tally[0]
    return runs[np.isfinite(runs).all(axis=1)]
