"""What a calibration says while it works."""

from collections.abc import Sequence
from typing import Protocol


class Progress(Protocol):
    """Takes note of how far a calibration is."""

    def plan(self, num_surrogate_runs: int, num_sumo_runs: int) -> None:
        """Say how many runs there will be, about."""
        ...

    def stage(self, name: str) -> None:
        """Say that another stage begins."""
        ...

    def surrogate_runs(self, num_runs: int) -> None:
        """Say that so many runs of the surrogate are done."""
        ...

    def sumo_runs(self, num_runs: int) -> None:
        """Say that so many runs of SUMO are done."""
        ...

    def best(self, accuracy: float) -> None:
        """Say how good the best candidate is by now."""
        ...

    def notes(self, lines: Sequence[str]) -> None:
        """Say what a user should know before the end."""
        ...


class Silent:
    """Says nothing, of calibrations and of sweeps."""

    def __enter__(self) -> "Silent":
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing."""

    def plan(self, num_surrogate_runs: int, num_sumo_runs: int) -> None:
        """Do nothing."""

    def stage(self, name: str) -> None:
        """Do nothing."""

    def surrogate_runs(self, num_runs: int) -> None:
        """Do nothing."""

    def sumo_runs(self, num_runs: int) -> None:
        """Do nothing."""

    def best(self, accuracy: float) -> None:
        """Do nothing."""

    def notes(self, lines: Sequence[str]) -> None:
        """Do nothing."""

    def begin(self, num_rows: int, num_missing: int) -> None:
        """Do nothing."""

    def rows(self, num_rows: int, num_failed: int) -> None:
        """Do nothing."""
