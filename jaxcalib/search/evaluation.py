"""What a search is told about its candidates, and what it says about itself."""

import enum

import numpy as np
from jaxtyping import Bool, Float

FAILED_ACCURACY = np.nan  # what is stored for a candidate that could not be evaluated


class SearchStatus(enum.StrEnum):
    """Where a search stands. All but the first two are final: the next ask is empty."""

    RUNNING = "running"
    RESAMPLED = "resampled"  # every candidate of this round failed; the next round begins afresh
    COMPLETE = "complete"
    THRESHOLD_REACHED = "threshold_reached"
    CONVERGED = "converged"
    NOTHING_SUCCEEDED = "nothing_succeeded"
    SELECTION_UNDEFINED = "selection_undefined"

    @property
    def is_final(self) -> bool:
        """Whether the search has nothing more to ask."""
        return self not in (SearchStatus.RUNNING, SearchStatus.RESAMPLED)

    @property
    def advice(self) -> str:
        """What the status means and what to do about it."""
        return _ADVICE[self]


_ADVICE = {
    SearchStatus.RUNNING: "The search has more candidates to ask.",
    SearchStatus.RESAMPLED: "Every candidate of the last round failed, so the next round begins afresh; "
    "look at the simulator's messages and narrow the bounds if this repeats.",
    SearchStatus.COMPLETE: "The search has used its budget.",
    SearchStatus.THRESHOLD_REACHED: "The search stopped early because the accuracy threshold was reached.",
    SearchStatus.CONVERGED: "Another step would not improve the result by more than its noise.",
    SearchStatus.NOTHING_SUCCEEDED: "No candidate could be evaluated; check the simulator and the bounds.",
    SearchStatus.SELECTION_UNDEFINED: "Eq. 19 is no probability when an accuracy is negative or all are zero; "
    "use the sound reading (`literal=False`).",
}


def is_successful(
    accuracy: Float[np.ndarray, "..."], is_ok: Bool[np.ndarray, "..."] | None = None
) -> Bool[np.ndarray, "..."]:
    """Return which evaluations count: finite and not flagged.

    Args:
        accuracy: at most 1; nan or infinite means failed.
        is_ok: what the simulator said about each evaluation; None means that all went well.

    Raises:
        ValueError: the shapes differ.
    """
    is_finite = np.isfinite(accuracy)
    if is_ok is None:
        return is_finite
    if is_ok.shape != accuracy.shape:
        raise ValueError(f"Expected `is_ok` in the shape of the accuracy {accuracy.shape}; got {is_ok.shape}.")
    return is_finite & is_ok
