"""The fold over a whole drive that is there already: the field's, or SUMO's."""

import jax
import numpy as np

from jaxcalib.measures.drive_tally import DriveTally
from surrogate.road.perception import PerceptionFrame


class WholeDriveFold:
    """Turns stacked frames into tallies.

    Frames are filled up to one length, so that all drives share one compiled program.
    """

    def __init__(self, tally: DriveTally, num_frames: int) -> None:
        """Prepare the fold for the frames of the longest drive; a longer one is compiled for itself."""
        self._num_frames = num_frames
        self._program = jax.jit(lambda frames: tally.of_frames(frames))  # a bound method of a record is not hashable

    def __call__(self, frames: PerceptionFrame) -> np.ndarray:
        """Return the tallies of a drive whose frames are stacked along a leading time axis."""
        missing = -len(frames.time_s) % self._num_frames
        # zeros mean "not valid", which the fold ignores
        filled = jax.tree.map(
            lambda leaf: np.concatenate([leaf, np.zeros((missing, *leaf.shape[1:]), leaf.dtype)]), frames
        )
        return np.asarray(self._program(filled), np.float64)
