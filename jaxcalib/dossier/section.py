"""What a dossier is made of: sections of statements and tables, of what speaks against it, and of what is missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from jaxcalib.calibration.result.result import rounded
from jaxcalib.html.page import percent

Cell = str | float | None


@dataclass(frozen=True)
class Statement:
    """A sentence, and where it can be checked."""

    text: str
    source: str  # file, and its key


@dataclass(frozen=True)
class Table:
    """A table, and where it can be checked."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    source: str  # file, and its key


@dataclass
class Section:
    """A heading of the credibility framework."""

    heading: str
    framework: str  # what EU 2022/1426 and UNECE's NATM call it
    statements: list[Statement] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)  # one line for each thing that speaks against the simulation
    missing: list[str] = field(default_factory=list)  # one line for each thing that an assessor will ask for

    def say(self, text: str, source: str) -> None:
        """Add a sentence."""
        self.statements.append(Statement(text, source))

    def show(self, title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]], source: str) -> None:
        """Add a table, unless it is empty; numbers with as many digits as mean anything."""
        if rows:
            shown = [tuple(rounded(cell) if isinstance(cell, float) else cell for cell in row) for row in rows]
            self.tables.append(Table(title, columns, shown, source))

    def fail(self, line: str) -> None:
        """Name what speaks against the simulation."""
        self.failures.append(line)

    def lack(self, line: str) -> None:
        """Name what is missing."""
        self.missing.append(line)


def words_of(name: str) -> str:
    """Return a name as words."""
    return name.replace("_", " ")


def searched_in(confirmation: Mapping[str, Any]) -> str:
    """Return which simulator made the runs of a search, and so what sensitivities and intervals rest on."""
    return "SUMO" if confirmation.get("searched_in_sumo") else "the surrogate"


def between(bounds: Sequence[float] | None) -> str:
    """Return an interval of shares."""
    return "-" if bounds is None else f"{percent(bounds[0])} to {percent(bounds[1])}"


def number_range(bounds: Any) -> str:
    """Return an interval of numbers; one that has an end alone is none."""
    return "-" if not bounds or None in bounds else f"{bounds[0]:.3g} to {bounds[1]:.3g}"
