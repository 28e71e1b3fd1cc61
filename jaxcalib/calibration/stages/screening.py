"""SOAT with range analysis on one box: all cases of an orthogonal array and what follows from them (Alg. 1, 2)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.stages.search_box import SearchBox
from jaxcalib.calibration.stages.search_run import Judged, SearchRun, best_of
from jaxcalib.runs.seeds import SHORTLIST_OFFSET
from jaxcalib.search import (
    OrthogonalArray,
    RangeAnalysis,
    SoatConfig,
    SoatInfo,
    analyse_ranges,
    orthogonal_array,
    soat,
)
from jaxcalib.search.least_squares.response_surface import ResponseSurface, fit_response_surface
from jaxcalib.search.least_squares.surface_step import levenberg_marquardt_step

MOST_LEVELS = 4  # as in the paper's studies
FEWER_LEVELS = 3  # where four would need an array of more than MOST_CASES
MOST_CASES = 64
NUM_SHORTLISTED = 2
SHORTLIST_RUNS = 4  # times as many runs as for a case


@dataclass(frozen=True)
class Screening:
    """What the cases of an orthogonal array showed."""

    box: SearchBox  # what was searched
    array: OrthogonalArray  # the design
    soat: SoatInfo  # the search as Algorithm 1 reports it
    ranges: RangeAnalysis
    cases: Judged  # all cases, the initial point last
    # the best cases, the initial point, the best level combination of the range analysis and the best point of
    # the response surface, run longer on other seeds
    shortlist: Judged
    best: Float[np.ndarray, " parameter"]  # unit-cube point of the best of the shortlist
    best_accuracy: float
    surface: ResponseSurface  # response of the residuals in the box


def screen(
    run: SearchRun,
    box: SearchBox,
    initial: Float[np.ndarray, " parameter"],
    num_runs: int,
    num_critical: int,
    stage: str,
    accuracy_threshold: float,
    literal: bool = False,
    array: OrthogonalArray | None = None,
    also: Float[np.ndarray, "candidate parameter"] | None = None,
) -> Screening:
    """Run all cases of the smallest array that fits, analyse ranges, and try what they propose.

    Args:
        run: evaluator and objective.
        box: parameters and bounds.
        initial: initial point in the unit cube, tested beside the cases.
        num_runs: runs per case.
        num_critical: K.
        stage: name for the record.
        accuracy_threshold: a_thre.
        literal: Algorithm 1 as printed.
        array: the design; the smallest that fits unless given.
        also: further candidates for the shortlist, in the unit cube.

    Source: Algorithms 1 and 2.
    Deviation: the best combination of levels, which the paper returns untested, is run like a case; beside it stands
        the minimum of a response surface fitted to all cases, which uses what the array measured between its levels.
        Who wins is decided by longer runs on other seeds.
    """
    num_parameters = len(box.chosen)
    array = smallest_array(num_parameters) if array is None else array
    bounds = np.zeros(num_parameters), np.ones(num_parameters)
    start = box.box_of(initial[None])[0]
    state = soat.init(array, *bounds, start, SoatConfig(accuracy_threshold, literal))
    cases = run.judge(box.unit_of(soat.ask(state)), num_runs, stage)
    state, info = soat.tell(state, cases.accuracy, cases.is_ok)
    in_array = slice(0, array.num_cases)
    ranges = analyse_ranges(array, cases.accuracy[in_array], num_critical, is_ok=cases.is_ok[in_array])

    points, is_ok = box.box_of(cases.unit), cases.is_ok
    # the surface averages the noise of the cases over its coefficients
    num_averaged = max(1, round(num_runs * is_ok.sum() / (2 * num_parameters + 1)))
    residuals = run.objective.residuals(cases.unit, cases.pooled, num_averaged)[is_ok]
    surface = fit_response_surface(
        points[is_ok], residuals, np.ones_like(residuals), np.full(num_parameters, 0.5), 0.5, is_quadratic=True
    )
    on_surface = levenberg_marquardt_step(surface, np.ones(surface.intercept.shape[0])).candidate
    levels = np.maximum(ranges.best_levels, 0) / (array.num_levels - 1)
    proposed = box.unit_of(np.stack([levels, on_surface, start]))
    few = np.vstack([best_of([cases], NUM_SHORTLISTED), proposed, *([] if also is None else [also])])
    shortlist = run.shortlist(few, SHORTLIST_RUNS * num_runs, stage, SHORTLIST_OFFSET)
    if literal and info.best_candidate is not None:  # Algorithm 1 returns the luckiest case, unseen since
        winner, accuracy = box.unit_of(info.best_candidate[None])[0], info.best_accuracy
    else:
        winner, accuracy = shortlist.unit[shortlist.best].copy(), float(shortlist.accuracy[shortlist.best])
    return Screening(
        box,
        array,
        info,
        ranges,
        cases,
        shortlist,
        winner,
        accuracy,
        surface,
    )


def smallest_array(num_parameters: int) -> OrthogonalArray:
    """Return the design that `screen` chooses for a number of parameters."""
    array = orthogonal_array(num_parameters, MOST_LEVELS)
    if array.num_cases <= MOST_CASES:
        return array
    return min(array, orthogonal_array(num_parameters, FEWER_LEVELS), key=lambda one: one.num_cases)


def small_array(num_parameters: int) -> OrthogonalArray:
    """Return the design with fewest cases of those with three or four levels: for answers that hardly bend."""
    designs = (orthogonal_array(num_parameters, levels) for levels in (MOST_LEVELS, FEWER_LEVELS))
    return min(designs, key=lambda one: (one.num_cases, -one.num_levels))
