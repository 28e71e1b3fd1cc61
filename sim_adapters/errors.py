"""Errors that a user can mend, and failures of a simulator."""

from pathlib import Path


class ScenarioError(ValueError):
    """A scenario that is wrong or that the surrogate cannot represent.

    The message is one line: which file, which element, what was expected.
    """

    def __init__(self, file: Path | str, message: str) -> None:
        """Join the file's name and the message."""
        super().__init__(f"{Path(file).name}: {message}")


class SimulationFailed(RuntimeError):
    """A simulator did not finish a run.

    Attributes:
        seed: seed of the run.
        log_tail: the last lines that the simulator wrote.
    """

    def __init__(self, message: str, seed: int, log_tail: str = "") -> None:
        """Keep what is needed to look into the failure."""
        super().__init__(message)
        self.seed = seed
        self.log_tail = log_tail
