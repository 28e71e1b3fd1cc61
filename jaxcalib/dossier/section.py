"""What a dossier is made of: sections with statements, tables, and what is missing."""

from collections.abc import Sequence
from dataclasses import dataclass, field


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
    rows: Sequence[Sequence[str | float | None]]
    source: str  # file, and its key


@dataclass
class Section:
    """A heading of the credibility framework."""

    heading: str
    framework: str  # what EU 2022/1426 and UNECE's NATM call it
    statements: list[Statement] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)  # one line for each thing that an assessor will ask for

    def say(self, text: str, source: str) -> None:
        """Add a sentence."""
        self.statements.append(Statement(text, source))

    def show(
        self, title: str, columns: Sequence[str], rows: Sequence[Sequence[str | float | None]], source: str
    ) -> None:
        """Add a table, unless it is empty."""
        if rows:
            self.tables.append(Table(title, columns, rows, source))

    def lack(self, line: str) -> None:
        """Name what is missing."""
        self.missing.append(line)
