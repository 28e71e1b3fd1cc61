"""Accuracy of a case from its replicates on several seeds, and how noisy one replicate is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxcalib.search.evaluation import FAILED_ACCURACY, is_successful


@dataclass(frozen=True)
class CaseMeans:
    """Replicates averaged over seeds."""

    accuracy: Float[np.ndarray, " case"]  # mean accuracy of each case; nan where too few replicates succeeded
    num_replicates: Int[np.ndarray, " case"]  # replicates that the mean rests on; 0 for failed cases
    replicate_variance: float  # variance of a single replicate around case effect + seed effect; nan if unknown
    replicate_degrees_of_freedom: int  # of that variance; 0 if unknown


def average_replicates(
    accuracy: Float[np.ndarray, "case seed"], is_ok: Bool[np.ndarray, "case seed"] | None = None
) -> CaseMeans:
    """Return the mean accuracy of every case, adjusted for the seeds that failed.

    The model is accuracy = case effect + seed effect + noise. The seed effect is common to all cases when they share
    random seeds; it cancels in every comparison of cases, so it is not counted as noise. Without failures the mean is
    the plain mean over seeds; with failures it is the least-squares estimate, so that a case is neither favoured nor
    harmed by the seeds it lost. A case needs more than half of the seeds: then any two cases share a seed.

    Args:
        accuracy: at most 1; nan means failed.
        is_ok: what the simulator said about each run; None means that all went well.

    Source: not in the paper, which runs one seed.
    """
    num_seeds = accuracy.shape[1]
    is_counted = is_successful(accuracy, is_ok)
    is_counted &= (2 * is_counted.sum(axis=1) > num_seeds)[:, None]
    num_replicates = is_counted.sum(axis=1)
    cases = np.flatnonzero(num_replicates)
    seeds = np.flatnonzero(is_counted.any(axis=0))
    mean = np.full(accuracy.shape[0], FAILED_ACCURACY)
    degrees_of_freedom = int(is_counted.sum() - (cases.size + seeds.size - 1))
    if not cases.size:
        return CaseMeans(mean, num_replicates, np.nan, 0)

    counted = accuracy[np.ix_(cases, seeds)]
    weight = is_counted[np.ix_(cases, seeds)].astype(np.float64)
    counted = np.where(weight > 0.0, counted, 0.0)
    # Eliminate the case effects: the reduced normal equations for the seed effects are seeds x seeds.
    per_case = weight.sum(axis=1)
    raw_mean = (weight * counted).sum(axis=1) / per_case
    normal_matrix = np.diag(weight.sum(axis=0)) - (weight / per_case[:, None]).T @ weight
    right_side = (weight * (counted - raw_mean[:, None])).sum(axis=0)
    # The matrix is singular along 1; the shortest solution is the one in which the seed effects have mean 0.
    seed_effect = np.linalg.lstsq(normal_matrix, right_side, rcond=None)[0]
    case_effect = raw_mean - (weight * seed_effect).sum(axis=1) / per_case
    mean[cases] = case_effect
    if degrees_of_freedom < 1:
        return CaseMeans(mean, num_replicates, np.nan, 0)
    residual = weight * (counted - case_effect[:, None] - seed_effect)
    return CaseMeans(mean, num_replicates, float((residual**2).sum() / degrees_of_freedom), degrees_of_freedom)
