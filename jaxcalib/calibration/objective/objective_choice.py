"""Which objective a calibration uses, made from the field and from runs near a point."""

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.evidence import Evidence
from jaxcalib.calibration.objective.moments import all_moments, moments_of, noise_covariance, observed_moments
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.measures.measure import Moe
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings


def choose_objective(
    problem: CalibrationProblem,
    settings: Settings,
    evidence: Evidence,
    runs: Float[np.ndarray, "run tally"],
) -> Objective:
    """Return the objective.

    Args:
        problem: the problem.
        settings: which objective is wanted.
        evidence: what is known of the parameters.
        runs: tallies of runs near where the search goes on, for the noise of the measures.
    """
    field = problem.field_of("fit")
    is_relative = settings.objective == "paper"
    if is_relative:
        # the paper averages the lane-changing distances that it sees; the restricted means of the MoEs are no quotients
        by_moe = {measure.moe: measure for measure in problem.measures.values() if measure.is_quotient}
        by_moe |= {measure.printed_moe: measure for measure in problem.measures.values() if measure.printed_moe}
        candidates = moments_of([by_moe[moe] for moe in Moe], problem.tally_index)
    else:
        candidates = all_moments(problem.measures, problem.tally_index, settings.also_match)
    moments = observed_moments(candidates, field, runs, on_both_sides=is_relative)
    in_field = moments.values(field.sum(axis=0))
    return Objective(
        moments=moments,
        field=in_field,
        covariance=noise_covariance(moments, runs, in_field),
        usual=moments.values(runs.sum(axis=0)),
        num_drives=float(field[:, moments.drives].sum()),
        evidence=evidence,
        is_relative=is_relative,
        is_summed=is_relative and settings.literal,
    )
