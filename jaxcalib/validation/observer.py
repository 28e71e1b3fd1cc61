"""What a validation keeps of a drive: tallies, histograms, and the subject vehicle's passing times, as one vector."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.validation.distributions import BORDERS, NUM_COUNTS, histograms
from jaxcalib.validation.trajectories import NOT_PASSED, passing_times_s, route_grid
from surrogate.road.perception import PerceptionFrame


@dataclass(frozen=True)
class ObservedDrives:
    """Drives, each with what was kept of it; leading axes are free."""

    tally: Float[np.ndarray, "... tally"]  # tallies
    histograms: dict[str, Float[np.ndarray, "... bin"]]  # counts of each quantity
    # when the subject vehicle passed each place of the grid; nan where it did not
    passing_s: Float[np.ndarray, "... place"]


class DriveObserver:
    """Turns the frames of a drive into one vector, and such vectors into their parts."""

    def __init__(self, problem: CalibrationProblem) -> None:
        """Prepare the fold."""
        self._fold = problem.fold
        self._num_tallies = len(problem.tally_names)
        self.grid_m = route_grid(float(problem.road.section_border_m[-1]))

    def __call__(self, frames: PerceptionFrame) -> np.ndarray:
        """Return the vector of a drive; every number is finite, as engines ask for."""
        passing = passing_times_s(frames, self.grid_m)
        parts = [self._fold(frames), *histograms(frames).values(), np.where(np.isfinite(passing), passing, NOT_PASSED)]
        return np.concatenate(parts)

    def parts(self, vectors: Float[np.ndarray, "... number"]) -> ObservedDrives:
        """Return the parts of vectors."""
        tally, counts, passing = np.split(vectors, [self._num_tallies, self._num_tallies + NUM_COUNTS], axis=-1)
        borders = np.cumsum([len(borders) - 1 for borders in BORDERS.values()])[:-1]
        return ObservedDrives(
            tally,
            dict(zip(BORDERS, np.split(counts, borders, axis=-1), strict=True)),
            np.where(passing == NOT_PASSED, np.nan, passing),
        )
