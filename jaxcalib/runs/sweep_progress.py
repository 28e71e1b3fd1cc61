"""How far a sweep is, for people at a terminal; where there is none, a plain line now and then."""

import time
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

PLAIN_INTERVAL_S = 30.0


class SweepProgress(Protocol):
    """Takes note of how far a sweep is."""

    def begin(self, num_rows: int, num_missing: int) -> None:
        """Say how many rows there will be, and how many of them are missing."""
        ...

    def rows(self, num_rows: int, num_failed: int) -> None:
        """Say that so many rows more are kept, and how many of them are of runs that failed."""
        ...


class TerminalSweepProgress:
    """Shows rows, rate and the time left. Use it as a context manager."""

    def __init__(self, console: Console | None = None) -> None:
        """Prepare the bar; it writes to standard error."""
        self._console = console or Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"),
            TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn(elapsed_when_finished=False),
            console=self._console, disable=not self._console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("reading the case", total=None, rate="")
        self._began_s = self._said_s = time.monotonic()
        self._total = self._done = self._made = self._failed = 0

    def __enter__(self) -> "TerminalSweepProgress":
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Take the bar away."""
        self._bar.stop()

    def begin(self, num_rows: int, num_missing: int) -> None:
        """Say how many rows there will be, and how many of them are missing."""
        self._total, self._done = num_rows, num_rows - num_missing
        self._began_s = time.monotonic()
        self._bar.update(self._task, description="runs", total=num_rows, completed=self._done)
        self._say(f"{self._done} of {num_rows} runs are there, {num_missing} to make")

    def rows(self, num_rows: int, num_failed: int) -> None:
        """Say that so many rows more are kept, and how many of them are of runs that failed."""
        self._done, self._made, self._failed = self._done + num_rows, self._made + num_rows, self._failed + num_failed
        rate = f"{self.rate_per_s:.3g} runs/s"
        self._bar.update(
            self._task, completed=self._done, rate=rate + (f", {self._failed} failed" * (self._failed > 0))
        )
        if time.monotonic() - self._said_s > PLAIN_INTERVAL_S or self._done == self._total:
            left_s = (self._total - self._done) / max(self.rate_per_s, 1e-9)
            self._say(f"{self._done} of {self._total} runs, {rate}, {self._failed} failed, {left_s:.0f} s left")

    @property
    def rate_per_s(self) -> float:
        """Runs per second since the sweep went on, compilation included."""
        return self._made / max(time.monotonic() - self._began_s, 1e-9)

    def _say(self, line: str) -> None:
        self._said_s = time.monotonic()
        if not self._console.is_terminal:
            self._console.print(line, highlight=False)
