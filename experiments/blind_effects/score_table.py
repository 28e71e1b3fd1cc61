"""The lines of the table, on the terminal and as a page."""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment
from rich.console import Console
from rich.table import Table

from experiments.blind_effects.rates import Rate


@dataclass(frozen=True)
class Line:
    """A line of the table."""

    title: str  # what is measured
    value: float | None  # a share or a number; None where there is nothing to measure
    of: int = 0  # cases that it rests on
    interval: tuple[float, float] | None = None  # Wilson's 95 % interval of a share
    least: float | None = None  # what is expected; at most, if `is_most`
    aim: float | None = None  # what would be good
    is_most: bool = False  # smaller is better
    # whether what is expected is reached; None where nothing is, or where there is nothing to measure
    is_met: bool | None = None
    note: str = ""  # what to know

    @classmethod
    def judged(
        cls,
        title: str,
        value: float | None,
        of: int,
        least: float | None = None,
        aim: float | None = None,
        *,
        is_most: bool = False,
        interval: tuple[float, float] | None = None,
    ) -> "Line":
        """Return a line with its judgement."""
        is_met = None
        if value is not None and least is not None:
            is_met = value <= least if is_most else value >= least
        return cls(title, value, of, interval, least, aim, is_most, is_met)

    @classmethod
    def of_rate(
        cls, title: str, share: Rate, least: float | None = None, aim: float | None = None, *, is_most: bool = False
    ) -> "Line":
        """Return the line of a share of cases."""
        if not share.of:
            return cls(title, None, 0, None, least, aim, is_most)
        interval = (share.low, share.high)
        return cls.judged(title, share.value, share.of, least, aim, is_most=is_most, interval=interval)

    def as_dict(self) -> dict[str, Any]:
        """Return the line for JSON."""
        return asdict(self) | {"value": None if self.value is None or math.isnan(self.value) else self.value}

    def cells(self) -> tuple[str, ...]:
        """Return title, value, interval, cases, expected, aim and judgement as texts."""
        sign = "<=" if self.is_most else ">="
        value = "-" if self.value is None or math.isnan(self.value) else f"{self.value:.2f}"
        interval = f"{self.interval[0]:.2f} to {self.interval[1]:.2f}" if self.interval else ""
        least = f"{sign} {self.least:g}" if self.least is not None else ""
        aim = f"{sign} {self.aim:g}" if self.aim is not None else ""
        judgement = {None: "", True: "yes", False: "NO"}[self.is_met]
        return self.title, value, interval, str(self.of), least, aim, " ".join(filter(None, (judgement, self.note)))


HEAD = ("what", "value", "95 % interval", "cases", "at least", "aim", "met")
PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Check on withheld effects</title>
<style>
 body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; color: #222 }
 table { border-collapse: collapse; margin: 1rem 0 2rem } td, th { padding: .25rem .7rem; text-align: left }
 tr { border-bottom: 1px solid #ddd } th { border-bottom: 2px solid #888 }
 .no { background: #fbe3e0 } .yes { background: #e6f3e6 }
</style>
<h1>Check on withheld effects</h1>
<p>{{ rows|length }} cases with an answer, {{ missing|length }} without; those count nowhere.
Intervals are Wilson's. A dash means that there is nothing to measure.</p>
<table><tr>{% for name in head %}<th>{{ name }}</th>{% endfor %}</tr>
{% for line in lines %}<tr class="{{ {True: 'yes', False: 'no'}.get(line.is_met, '') }}">
{%- for cell in line.cells() %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}</table>
<h2>Case by case</h2>
<table><tr>{% for name in rows[0] %}<th>{{ name|replace('_', ' ') }}</th>{% endfor %}</tr>
{% for row in rows %}<tr>{% for cell in row.values() %}<td>
{%- if cell is none %}-{% elif cell is string or cell is number %}{{ cell }}{% else %}{{ cell|join(', ') }}{% endif -%}
</td>{% endfor %}</tr>
{% endfor %}</table></html>
"""


def show(console: Console, lines: list[Line]) -> None:
    """Print the table."""
    table = Table(*HEAD, title="Check on withheld effects")
    for line in lines:
        table.add_row(*line.cells(), style="red" if line.is_met is False else "")
    console.print(table)


def recorded_line(line: Line) -> dict[str, str]:
    """Return a line of the table as a row to keep."""
    title, value, interval, of, least, aim, judgement = line.cells()
    return {"what": title, "value": value, "95 % interval": interval, "cases": of, "asked": least, "aim": aim,
            "met": judgement}  # fmt: skip


def recorded_case(row: dict[str, Any]) -> dict[str, str]:
    """Return a case's row as one to keep; sealed names say nothing."""
    truth = " and ".join(f"{name} {strength:g}" for name, strength in zip(row["true"], row["strengths"], strict=True))
    return {
        "road": row["road"],
        "kind": row["kind"],
        "truth": truth or "-",
        "level": row["level"],
        "verdict": row["verdict"],
        "named": ", ".join(row["named"]),
        "told": ", ".join(row["told"]),
        "time, s": f"{row['wall_s']:.0f}",
    }


def write_page(file: Path, lines: list[Line], rows: list[dict[str, Any]], missing: list[str]) -> None:
    """Write the table as a page."""
    page = Environment(autoescape=True).from_string(PAGE)
    text = page.render(head=HEAD, lines=lines, rows=rows, missing=missing)
    file.write_text(text, encoding="utf-8")
