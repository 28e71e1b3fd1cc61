"""The .json and the page beside a sweep's table."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from markupsafe import Markup

from jaxcalib.html.page import render_page
from jaxcalib.measures.registry import judged_measures
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.disk import writing_to
from jaxcalib.runs.profile import profile
from jaxcalib.sweeps.columns import OBSERVATIONS
from jaxcalib.sweeps.figures import dependence_figure, influence_figure
from jaxcalib.sweeps.influence import candidate_means, rank_correlation
from jaxcalib.sweeps.store import SweepStore
from sim_adapters.atomic_file import write_atomically

OTHER_COLUMNS = ["candidate", "status", "num_collisions", "num_teleports", "backlog_share", "wall_s"]
LARGE_BACKLOG = 0.05


def report_files(table: Path) -> tuple[Path, Path]:
    """Return the files of a report, in numbers and in pictures, the last to be written last."""
    return table.with_suffix(".json"), table.with_suffix(".html")


def write_report(table: Path, problem: CalibrationProblem | None) -> None:
    """Write what was swept, in numbers and in pictures, beside the table; with a problem the field's values, too.

    Raises:
        ResourceError: the disk is full.
    """
    in_numbers, in_pictures = report_files(table)
    description = SweepStore(table).description()
    shown = judged_measures()
    column_of = {name: one["column"] for name, one in description["parameters"].items() if one["varied"]}
    columns = [*OTHER_COLUMNS, *column_of.values(), *shown, *(OBSERVATIONS + name for name in shown)]
    read = pq.ParquetFile(table).read(columns)
    rows = {name: read[name].to_numpy() for name in columns}
    summary = summarise(rows)
    text = json.dumps(description | {"summary": summary, "profile": profile()}, indent=1) + "\n"
    with writing_to(table.parent):
        write_atomically(in_numbers, lambda stream: stream.write(text.encode()))
    means = candidate_means(rows, column_of, shown)
    correlation = rank_correlation(means)
    is_known = bool(np.isfinite(correlation).any())
    page = render_page(
        "sweep.html.j2",
        description=description,
        summary=summary,
        influence=Markup(influence_figure(means, correlation)) if is_known else "",
        dependence=Markup(dependence_figure(means, correlation, field_values(problem, shown))) if is_known else "",
        number=lambda value: f"{value:.5g}",
    )
    with writing_to(table.parent):
        write_atomically(in_pictures, lambda stream: stream.write(page.encode()))


def summarise(rows: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return what became of the runs, counted."""
    return {
        "statuses": dict(Counter(rows["status"].tolist()).most_common()),
        "runs_with_collisions": int((rows["num_collisions"] > 0).sum()),
        "runs_with_teleports": int((rows["num_teleports"] > 0).sum()),
        "runs_with_backlog_above_5_percent": int((rows["backlog_share"] > LARGE_BACKLOG).sum()),
        "computing_s": round(float(np.nansum(rows["wall_s"])), 1),
    }


def field_values(problem: CalibrationProblem | None, names: Sequence[str]) -> dict[str, float]:
    """Return the field's value of each measure, drives to fit pooled; nothing where there is no problem."""
    if problem is None:
        return {}
    tally = dict(zip(problem.tally_names, problem.field_of("fit").sum(axis=0), strict=True))
    return {name: problem.measures[name].value(tally).value for name in names}
