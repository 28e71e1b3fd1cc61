"""Rows of results for people at a terminal, and in files that are there as a whole or not at all."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from experiments.results.record import Row
from sim_adapters.atomic_file import write_atomically


def as_table(rows: Sequence[Row], title: str) -> Table:
    """Return rows as a table; its columns are the first row's."""
    table = Table(title=title)
    for heading in rows[0]:
        table.add_column(heading)
    for row in rows:
        table.add_row(*("" if cell is None else str(cell) for cell in row.values()))
    return table


def write_json(file: Path, content: Any) -> None:
    """Write a file in a folder that is made if need be."""
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, indent=1)
    write_atomically(file, lambda stream: stream.write(text.encode()))
