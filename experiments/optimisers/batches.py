"""What optimisers share that draw each batch anew from all that was told."""

from abc import abstractmethod
from dataclasses import dataclass

from jaxtyping import Float
from numpy import ndarray

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, info_of

Candidates = Float[ndarray, "candidate parameter"]


@dataclass(frozen=True)
class BatchState:
    """All that was told, and what is asked."""

    setting: Setting
    candidates: Candidates
    told: Told | None = None
    num_batches: int = 1


class BatchOptimiser(Optimiser):
    """Asks for a batch at a time."""

    @abstractmethod
    def first(self, setting: Setting) -> Candidates:
        """Return the first batch."""

    @abstractmethod
    def following(self, setting: Setting, told: Told, number: int) -> Candidates:
        """Return the batch of a number, after all that was told."""

    def init(self, setting: Setting) -> BatchState:
        """Return the first state."""
        return BatchState(setting, self.first(setting))

    def ask(self, state: BatchState) -> Candidates:
        """Return the batch."""
        return state.candidates.copy()

    def tell(self, state: BatchState, told: Told) -> tuple[BatchState, RoundInfo]:
        """Return the state with the next batch."""
        together = told.joined(state.told)
        candidates = self.following(state.setting, together, state.num_batches)
        return BatchState(state.setting, candidates, together, state.num_batches + 1), info_of(told)
