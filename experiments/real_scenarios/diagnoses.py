"""What diagnoses of scenarios made by others answer: their logs hold no effect, so each name is a false alarm."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.blind_effects.run import ANSWER
from experiments.results.record import Row

SILENT = ("no_gap", "miscalibrated", "not_testable")
GAPS = {
    "gap_default": "scenario as it is",
    "gap_recalibrated": "recalibrated",
    "gap_with_effect": "with what is named",
    "noise_floor": "chance alone",
}


def diagnosed_rows(runs: Path) -> list[Row]:
    """Return a row for each RUN of a folder that has an answer."""
    return [_row(file.parent.name, json.loads(file.read_text())) for file in sorted(runs.glob(f"*/{ANSWER}"))]


def _row(name: str, answer: dict[str, Any]) -> Row:
    gaps = {words: answer["how_far"].get(key) for key, words in GAPS.items()}
    return {
        "case": name,
        "verdict": answer["verdict"],
        "named": ", ".join(answer["effects"]),
        **{f"gap, {words}": None if gap is None else round(gap, 2) for words, gap in gaps.items()},
        "time, s": round(answer["wall_s"]["total"]),
    }


def counted(rows: Sequence[Row]) -> str:
    """Return how many were silent, as they should be, how many named something, and how many called it unknown."""
    silent = sum(row["verdict"] in SILENT for row in rows)
    unknown = sum(row["verdict"] == "unknown" for row in rows)
    return (
        f"of {len(rows)}: silent {silent}, unknown {unknown}, an effect or a set named {len(rows) - silent - unknown}"
    )
