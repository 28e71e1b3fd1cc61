"""Adds up times by part."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up the time of each part."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Begin with nothing."""
        self._clock = clock
        self.wall_s: dict[str, float] = {}

    def add(self, name: str, wall_s: float) -> None:
        """Add time to a part."""
        self.wall_s[name] = self.wall_s.get(name, 0.0) + wall_s

    @contextmanager
    def time(self, name: str) -> Iterator[None]:
        """Add the time of a block."""
        stop = self.start(name)
        try:
            yield
        finally:
            stop()

    def start(self, name: str) -> Callable[[], None]:
        """Start to time a part; return what is called at its end."""
        began = self._clock()
        return lambda: self.add(name, self._clock() - began)
