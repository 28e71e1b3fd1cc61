"""Drivers who do not crash: others make no traffic that a road could show.

Following parameters drawn one by one may be such that drivers cannot stop behind a wave: SUMO takes whoever ran into
another off the road, and the surrogate refuses such values. A field of them is nobody's, and cannot be found back.
"""

from collections.abc import Callable, Iterable

import numpy as np

from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunOutcome, RunRequest

MOST_DRAWS = 200
FIRST_SEED = 2_000_000_000  # of the runs that look; fields and calibrations have others


def first_crash_free_draw(problem: CalibrationProblem, values_of: Callable[[int], Iterable[np.ndarray]]) -> int:
    """Return the number of the first draw with whose values nobody crashes in SUMO.

    Args:
        problem: the problem; the first and the last departure of its drives are run.
        values_of: parameter values of a draw, one vector for each demand, those with most crashes first.

    Raises:
        CaseError: with each of `MOST_DRAWS` draws somebody does.
    """
    starts = problem.drive_starts("fit")
    with sumo_engine(problem) as sumo:

        def is_crash_free(values: np.ndarray) -> bool:
            requests = [
                RunRequest(tuple(values.tolist()), FIRST_SEED + number, one.depart_s, drive=one.drive)
                for number, one in enumerate((starts[0], starts[-1]))
            ]
            return all(map(_is_without_crash, sumo.run(requests)))

        for draw in range(MOST_DRAWS):
            if all(map(is_crash_free, values_of(draw))):
                return draw
    raise CaseError("command line", "--patterns", f"drivers crash in SUMO with each of {MOST_DRAWS} draws.")


def _is_without_crash(outcome: RunOutcome) -> bool:
    return outcome.status.is_ok and outcome.num_collisions == 0
