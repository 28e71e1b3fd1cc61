"""`python -m experiments.fidelity.road_family`: how the surrogate differs from SUMO over roads drawn at random."""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.progress import track

from experiments.fidelity.on_road import Point, compare_on_road
from experiments.results.record import Row
from experiments.results.record import record as keep
from experiments.results.terminal import as_table, write_json
from experiments.roads.drawn_road import DRAWN
from experiments.roads.road_plan import draw_plan
from jaxcalib.problem.engines import DECISION_INTERVAL_S, prepare_devices

LEAST_SHARE, MOST_DIFFERENCE = 0.85, 0.15  # of alike sections; of probabilities of a breakdown
app = App(name="experiments.fidelity.road_family", help="Surrogate against SUMO over drawn roads.")


@app.default
def road_family(
    *,
    roads: Annotated[int, Parameter(validator=Number(gte=1))] = 20,
    first: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    runs: Annotated[int, Parameter(validator=Number(gte=2))] = 12,
    decisions: Annotated[float, Parameter(validator=Number(gt=0))] = DECISION_INTERVAL_S,
    out: Path = Path("road_family"),
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Compare both simulators at equal values on drawn roads; what is in OUT already is read.

    Parameters
    ----------
    roads
        Number of roads.
    first
        Seed of the first road; the others follow.
    runs
        Drives in SUMO for each road and demand; the surrogate makes four times as many.
    decisions
        Time in s between two decisions of the surrogate about lanes.
    out
        Folder for cases and results.
    record
        Keep the table in experiments/results.
    """
    prepare_devices(len(os.sched_getaffinity(0)))
    rows, points = [], []
    for seed in track(range(first, first + roads), "roads", console=Console(stderr=True)):
        found = _compared(seed, out, runs, decisions)
        rows.append(row_of(seed, found))
        points += found
    notes = summary_of(points)
    Console().print(as_table(rows, "surrogate against SUMO over drawn roads"), "\n".join(notes))
    if record:
        title = f"Roads drawn at random, decisions every {decisions:g} s"
        keep("fidelity", f"road_family_{decisions:g}", rows, title, [f"- {note}" for note in notes])
    return 0


def _compared(seed: int, out: Path, runs: int, decisions_s: float) -> list[dict[str, Any]]:
    file = out / f"{DRAWN}{seed}_{decisions_s:g}.json"
    if not file.is_file():
        found = compare_on_road(f"{DRAWN}{seed}", out / "cases" / f"{DRAWN}{seed}", runs, decisions_s)
        write_json(file, [Point.as_table(point) for point in found])
    return json.loads(file.read_text(encoding="utf-8"))


def row_of(seed: int, points: Sequence[dict[str, Any]]) -> Row:
    """Return the row of a road."""
    plan = draw_plan(seed)
    worst = max(points, key=lambda point: abs(point["surrogate_any"] - point["sumo_any"]))
    inserted = [abs(each["surrogate"] - each["sumo"]) for point in points for each in point["inserted"]]
    return {
        "road": seed,
        "lanes": plan.lanes,
        "along it": " ".join(plan.elements),
        "km/h": f"{plan.limit_kmh:g}",
        "demand / capacity": f"{plan.demand_share:.2f}",
        "sections alike": f"{np.mean([one for point in points for one in alike(point)]):.0%}",
        "at each demand": " ".join(f"{np.mean(alike(point)):.0%}" for point in points),
        "breakdown, SUMO": " ".join(f"{point['sumo_any']:.2f}" for point in points),
        "surrogate": " ".join(f"{point['surrogate_any']:.2f}" for point in points),
        "at most apart": f"{abs(worst['surrogate_any'] - worst['sumo_any']):.2f}",
        "insertion apart": f"{max(inserted):.1%}",
    }


def alike(point: dict[str, Any]) -> list[bool]:
    """Return which sections are alike at one demand."""
    return [section["is_alike"] for section in point["agreement"]["sections"]]


def summary_of(points: Sequence[dict[str, Any]]) -> list[str]:
    """Return what all roads together show, one line each."""
    share = np.mean([one for point in points for one in alike(point)])
    apart = np.asarray([point["surrogate_any"] - point["sumo_any"] for point in points])
    # two standard errors of SUMO's share
    chance = [2.0 * np.sqrt(0.25 / point["sumo_drives"]) for point in points]
    near = np.mean(np.abs(apart) <= MOST_DIFFERENCE)
    explained = np.mean(np.abs(apart) <= np.maximum(MOST_DIFFERENCE, chance))
    return [
        f"sections alike (speed within 10 %, or two standard errors): {share:.1%} ({LEAST_SHARE:.0%} asked)",
        f"probability that a drive meets a breakdown, surrogate - SUMO: mean {apart.mean():+.3f}, mean of sizes "
        f"{np.abs(apart).mean():.3f}, within {MOST_DIFFERENCE:g} in {near:.0%} of {len(points)} (and chance: "
        f"{explained:.0%})",
    ]


if __name__ == "__main__":
    sys.exit(app())
