"""Which runs are made together.

A batch lasts as long as its longest run, and some runs take twice as long as most: who outlasts half of his batch
waits, and goes on together with others of that kind.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

SHARE_LEFT = 0.5  # of the runs of a batch may be left when it is interrupted


@dataclass
class Going:
    """A run that is not over."""

    number: int  # its place in the caller's list
    state: Any = None  # where it is; None at its start
    wall_s: float = 0.0  # computing time spent on it so far


class RunQueue:
    """Runs that wait for a place in a batch."""

    def __init__(self, numbers: Sequence[int], batch: int) -> None:
        """Put runs in the queue.

        Args:
            numbers: their places in the caller's list, those first that are to begin first.
            batch: places of a batch.
        """
        self._fresh = deque(Going(number) for number in numbers)
        self._interrupted: deque[Going] = deque()
        self._batch = batch

    def take(self) -> list[Going]:
        """Return the runs of the next batch; none if all are over."""
        runs: list[Going] = []
        full_of_interrupted = len(self._interrupted) >= self._batch
        first, then = (self._interrupted, self._fresh) if full_of_interrupted else (self._fresh, self._interrupted)
        for waiting in (first, then):
            while waiting and len(runs) < self._batch:
                runs.append(waiting.popleft())
        return runs

    @property
    def share_left(self) -> float:
        """Share of the runs of the batch just taken that may be left; none if nobody else waits."""
        return SHARE_LEFT if self._fresh or self._interrupted else 0.0

    def put_back(self, run: Going) -> None:
        """Let a run wait for others to go on with."""
        self._interrupted.append(run)
