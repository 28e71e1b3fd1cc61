"""The page of a study: every table in the same form, from its JSON alone."""

from collections.abc import Mapping
from typing import Any

DIGITS = 4  # of numbers that are not whole


def markdown(study: Mapping[str, Any]) -> str:
    """Return the page of a study."""
    parts = [f"# {study['title']}", *_paragraphs(study.get("introduction", ()))]
    for table in study["tables"]:
        parts += [f"## {table['title']}", _origin(table)]
        if table["rows"]:
            parts.append(_table(table["rows"][-(table.get("num_shown") or len(table["rows"])) :]))
        parts += _paragraphs(table["notes"])
    return "\n\n".join(parts) + "\n"


def _paragraphs(text: Any) -> list[str]:
    return [text] if isinstance(text, str) else list(text)


def _origin(table: Mapping[str, Any]) -> str:
    commit = table["commit"]
    words = (
        f"measured {table['date']}" if table["date"] else "",
        f"commit {commit[:10]}{'-changed' if commit.endswith('-changed') else ''}" if commit else "commit not known",
        table["machine"] or "machine not stated",
        f"`{table['command']}`" if table["command"] else "",
    )
    return f"*{' · '.join(word for word in words if word)}*"


def _table(rows: list[Mapping[str, Any]]) -> str:
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = [_line(columns), f"|{'---|' * len(columns)}"]
    lines += [_line([cell(row.get(column)) for column in columns]) for row in rows]
    return "\n".join(lines)


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(each.replace("|", "\\|") for each in cells) + " |"


def cell(value: Any) -> str:
    """Return how a value stands in a table: numbers with four digits, nothing for what is not known."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
