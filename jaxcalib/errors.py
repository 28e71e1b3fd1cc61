"""Errors that users meet, each in one line: a wrong case, or something outside the program that gave out."""

from collections.abc import Iterable
from pathlib import Path

LONGEST_MESSAGE = 300
LONGEST_PART = 60


class CaseError(ValueError):
    """A case that is wrong; the command ends with exit code 2.

    The message is one line of at most 300 characters: which file, which row or key, what was expected.

    Attributes:
        file: name of the file.
        place: row or key in it, empty where the whole file is meant.
        expected: what was expected, and what was found.
        others: further faults of the same file, found at the same time.
    """

    others: tuple["CaseError", ...] = ()

    def __init__(self, file: Path | str, place: str, expected: str) -> None:
        """Keep the three parts; the file without its folder."""
        self.file, self.place, self.expected = Path(file).name, place, expected
        super().__init__(file, place, expected)  # all arguments, so that the error survives pickling

    def __str__(self) -> str:
        """Return the one line."""
        name = shorten(self.file, LONGEST_PART)
        where = f"{name}: {shorten(self.place, 2 * LONGEST_PART)}" if self.place else name
        return shorten(f"{where}: {self.expected}", LONGEST_MESSAGE)


def raise_faults(faults: Iterable[CaseError]) -> None:
    """Raise the first of some faults, which carries the others; without any, do nothing."""
    found = list(faults)
    if found:
        found[0].others = tuple(found[1:])
        raise found[0]


class ResourceError(RuntimeError):
    """Something outside the program gave out: a disk, a cluster; the command ends with exit code 4.

    The message is one line that says what happened, what is kept, and how to go on.
    """


def shorten(text: str, longest: int = LONGEST_PART) -> str:
    """Return text from a file fit for one line of a terminal.

    Control characters and line breaks go: an id in a stranger's file could otherwise move the cursor or fake a line.
    """
    line = "".join(c if c.isprintable() else " " if c.isspace() else "" for c in text)
    return line if len(line) <= longest else f"{line[: longest - 3]}..."


def quote(value: object) -> str:
    """Return a value as messages show it: text in quotes, everything shortened."""
    if isinstance(value, str):
        return f'"{shorten(value)}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "a list" if value else "an empty list"
    return shorten(str(value))
