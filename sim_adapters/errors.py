"""Errors that a user can mend."""

from pathlib import Path


class TooLargeBatchError(RuntimeError):
    """A batch of runs that does not fit into the memory of the devices; the message says how many would."""


class WorkersEndedError(RuntimeError):
    """SUMO's worker processes end before they can work; the message says what a script must do."""

    def __init__(self) -> None:
        """Say it."""
        super().__init__(
            "SUMO's workers end before they can work. A script that calls jaxcalib has to do so under "
            '`if __name__ == "__main__":`, for workers import the script.'
        )


class ScenarioError(ValueError):
    """A scenario that is wrong or that the surrogate cannot represent.

    The message is one line: which file, which element, what was expected.
    """

    others: tuple["ScenarioError", ...] = ()  # further ones of the same kind, found at the same time

    def __init__(self, file: Path | str, message: str) -> None:
        """Keep the file and the message."""
        super().__init__(file, message)
        self.file = Path(file)
        self.message = message

    def __str__(self) -> str:
        """Return the line."""
        return f"{self.file.name}: {self.message}"
