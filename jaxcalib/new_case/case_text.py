"""The text of a new case.toml: every key with its value, and with a comment where the program guessed."""

import json
from dataclasses import dataclass, field

from jaxcalib.case.case import Role

HEAD = '# Made by `jaxcalib new`. Lines that say "guess" are worth a look; docs/case.md says what each key means.'

TIME_ZERO = "guess: the log's clock is another than the scenario's; the first row is put where the road is filled"


@dataclass(frozen=True)
class Line:
    """A key with its value; a comment says where the value is from, and whether it is a guess."""

    key: str
    value: str | float | tuple[str, ...]
    comment: str = ""

    def __str__(self) -> str:
        """Return it as TOML."""
        return f"{self.key} = {_toml(self.value)}" + (f"  # {self.comment}" if self.comment else "")


@dataclass(frozen=True)
class Table:
    """A table of the file; `notes` stand above it as comments."""

    name: str
    lines: tuple[Line, ...]
    notes: tuple[str, ...] = field(default=())

    def __str__(self) -> str:
        """Return it as TOML."""
        return "\n".join([*(f"# {_line(note)}" for note in self.notes), self.name, *map(str, self.lines)])


@dataclass(frozen=True)
class NewDrive:
    """A [[drive]]."""

    id: str
    depart_s: float
    subject: str
    objects: str
    role: Role
    time_zero: float | None = None

    def table(self, comment: str) -> Table:
        """Return its table; the comment stands at the departure."""
        return Table(
            "[[drive]]",
            (
                Line("id", self.id),
                Line("depart_s", self.depart_s, comment),
                Line("subject", self.subject),
                Line("objects", self.objects),
                Line("role", self.role),
                *([] if self.time_zero is None else [Line("time_zero", self.time_zero, TIME_ZERO)]),
            ),
        )


def case_text(name: str, tables: list[Table], log_text: str = "") -> str:
    """Return the text of case.toml; `log_text` is its section [log]."""
    parts = [HEAD, f"format = 1\nname = {_toml(name)}", *map(str, tables), log_text.strip()]
    return "\n\n".join(filter(None, parts)) + "\n"


def _toml(value: str | float | tuple[str, ...]) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):  # TOML's basic strings know JSON's escapes
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value))


def _line(text: str) -> str:
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
