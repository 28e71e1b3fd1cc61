"""`python -m experiments.fidelity`: prints and writes how far the surrogate is from SUMO."""

import json
import os
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from experiments.fidelity.equilibrium import MOST_DIFFERENCE, NO_EQUILIBRIUM, closed_form_table, sumo_table
from experiments.fidelity.fidelity_record import record_tables
from experiments.fidelity.insertion import insertion_table
from experiments.fidelity.lane_changes import ALWAYS, lane_change_table
from experiments.fidelity.parity import MOST_DIFFERENCE_M, SUMO_MODELS, parity_table
from experiments.fidelity.roc_figure import write_roc_figure
from experiments.fidelity.timed_change import timed_change_table
from experiments.fidelity.transfer import Transfer, cases_of, run_cases, transfer_of
from jaxcalib.problem.engines import prepare_devices
from jaxcalib.problem.problem import CalibrationProblem, read_problem

Tables = dict[str, object]
CASE = Path(__file__).parents[1] / "cases" / "corridor"
LEAST_RANK, MOST_BIAS, MOST_INSERTION_DIFFERENCE = 0.8, 0.15, 0.05
app = App(name="experiments.fidelity", help="How far the surrogate is from SUMO.")


@app.default
def fidelity(
    case: Path = CASE,
    /,
    *,
    data: Path = Path("../shared/data"),
    out: Path = Path("fidelity.json"),
    leaders: Annotated[int, Parameter(validator=Number(gte=1))] = 5,
    runs: Annotated[int, Parameter(validator=Number(gte=0))] = 10,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Compare the surrogate with SUMO.

    Parameters
    ----------
    case
        Case for the transfer of measures and effects and for insertion.
    data
        Folder of the recordings; without it, what needs them is left out.
    out
        File for the tables.
    leaders
        Recorded leaders of each data set for the parity of car-following.
    runs
        Runs of each of the 64 parameter sets in SUMO, at least, each drive to fit equally often; the surrogate makes
        four times as many. 0 leaves transfer and insertion out.
    record
        Also write the tables to experiments/results.
    """
    console = Console()
    sumo = metadata.version("libsumo")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    tables: Tables = {"date": now, "sumo": sumo, "case": case.resolve().name}
    prepare_devices(len(os.sched_getaffinity(0)))
    console.print(f"SUMO {sumo}")
    if (data / "car_following").is_dir():
        tables["parity"] = rows = parity_table(data, leaders)
        show_parity(console, rows)
    else:
        console.print(f"Left out: car-following parity, for {data / 'car_following'} is not there.")
    if (data / "freeway").is_dir():
        tables["lane_changes"] = rows = lane_change_table(data)
        show_lane_changes(console, rows)
        figure = out.with_name(f"{out.stem}_lane_changes.svg")
        write_roc_figure(rows, figure)
        console.print(f"written: {figure}")
    else:
        console.print(f"Left out: real lane changes, for {data / 'freeway'} is not there.")
    _equilibrium(console, tables)
    tables["timed_lane_changes"] = rows = timed_change_table()
    show_timed_changes(console, rows)
    if runs:
        problem = read_problem(case)
        _transfer(console, tables, problem, runs)
        tables["insertion"] = rows = insertion_table(problem)
        show_insertion(console, rows)
    out.write_text(json.dumps(tables, indent=1) + "\n", encoding="utf-8")
    console.print(f"written: {out}")
    if record:
        record_tables(tables)
    return 0


def show_parity(console: Console, rows: list[dict]) -> None:
    """Print how far followers are from SUMO's."""
    headings = ("model", "leaders", "precision", "median", "largest", f"at most {MOST_DIFFERENCE_M:g}")
    shown = _table("car-following parity: largest difference in position, m", headings)
    for model in dict.fromkeys(row["model"] for row in rows):
        for precision in ("double", "single"):
            differences_m = sorted(row[f"{precision}_precision_m"] for row in rows if row["model"] == model)
            verdict = "yes" if differences_m[-1] <= MOST_DIFFERENCE_M else "no"
            middle, largest = f"{differences_m[len(differences_m) // 2]:.2g}", f"{differences_m[-1]:.2g}"
            shown.add_row(model, str(len(differences_m)), precision, middle, largest, verdict)
    console.print(shown)


def show_lane_changes(console: Console, rows: list[dict]) -> None:
    """Print how well rules tell recorded decisions."""
    headings = (
        "rule", "accuracy", "balanced accuracy", "area under ROC", "log loss", "fitted on the other site",
        "better than always",
    )  # fmt: skip
    shown = _table(f"{rows[0]['num_decisions']} recorded lane-change decisions: gap taken or let pass", headings)
    for row in rows:
        low, high = row["roc_area_interval"]
        fitted = f"{row['fitted_balanced_accuracy']:.3f}" if row.get("parameter") else ""
        verdict = "" if row["rule"] == ALWAYS else "yes" if low > 0.5 else "no"
        shown.add_row(
            row["rule"], f"{row['accuracy']:.1%}", f"{row['balanced_accuracy']:.3f}",
            f"{row['roc_area']:.3f} ({low:.3f} to {high:.3f})", f"{row['log_loss']:.3f}", fitted, verdict,
        )  # fmt: skip
    console.print(shown)


def show_timed_changes(console: Console, rows: list[dict]) -> None:
    """Print how far a lane change that takes time is from SUMO's."""
    headings = ("duration", "largest difference in position", f"at most {MOST_DIFFERENCE_M:g} m", "lane differs")
    shown = _table("one lane change among four neighbours, step by step against SUMO", headings)
    for row in rows:
        verdict = "yes" if row["largest_difference_m"] <= MOST_DIFFERENCE_M else "no"
        steps = f"in {row['lane_differs_steps']} steps"
        shown.add_row(f"{row['duration_s']:g} s", f"{1000.0 * row['largest_difference_m']:.1f} mm", verdict, steps)
    console.print(shown)


def _equilibrium(console: Console, tables: Tables) -> None:
    tables["equilibrium"] = rows = closed_form_table()
    tables["equilibrium_in_sumo"] = in_sumo = sumo_table("W99", SUMO_MODELS["W99"])
    tables["no_equilibrium"] = NO_EQUILIBRIUM
    headings = ("model", "against", "uniform", "disturbed by 5 %", f"at most {MOST_DIFFERENCE:.0%}")
    shown = _table("flow at given density: largest difference from closed form or SUMO", headings)
    for model in dict.fromkeys(row["model"] for row in rows):
        of_model = [row for row in rows if row["model"] == model]
        largest, disturbed = (
            max(abs(row[key]) for row in of_model) for key in ("relative_difference", "relative_difference_disturbed")
        )
        verdict = "yes" if largest <= MOST_DIFFERENCE else "no"
        waves = " (waves)" if disturbed > MOST_DIFFERENCE else ""
        shown.add_row(model, "closed form", f"{largest:.2%}", f"{disturbed:.1%}{waves}", verdict)
    largest = max(abs(row["relative_difference"]) for row in in_sumo)
    shown.add_row("w99-sumo128", "SUMO", f"{largest:.2%}", "", "yes" if largest <= MOST_DIFFERENCE else "no")
    for model, reason in NO_EQUILIBRIUM.items():
        shown.add_row(model, "-", "-", "", reason)
    console.print(shown)


def _transfer(console: Console, tables: Tables, problem: CalibrationProblem, runs: int) -> None:
    array, values = cases_of(problem)
    terminal = Console(stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal) as bar:
        task = bar.add_task(f"{array.name} in SUMO", total=len(values))
        ours, theirs = run_cases(problem, values, runs, lambda: bar.update(task, advance=1))
    transfer = transfer_of(problem, array, ours, theirs)
    tables["transfer"] = {
        "array": array.name,
        "runs_per_case": {"surrogate": ours.tally.shape[1], "sumo": theirs.tally.shape[1]},
        "num_failed": {"surrogate": transfer.num_failed[0], "sumo": transfer.num_failed[1]},
        "measures": [vars(measure) for measure in transfer.measures],
        "effects": [vars(effect) | {"counts": effect.counts} for effect in transfer.effects],
    }
    show_transfer(console, transfer)


def show_transfer(console: Console, transfer: Transfer) -> None:
    """Print how measures and main effects agree."""
    headings = ("measure", "spread in noise", f"rank correlation >= {LEAST_RANK:g}", f"bias <= {MOST_BIAS:.0%}")
    shown = _table("measures over the array's cases, surrogate against SUMO", headings)
    for measure in sorted(transfer.measures, key=lambda measure: measure.rank_correlation):
        rank, bias = f"{measure.rank_correlation:.3f}", f"{measure.bias:+.1%}"
        rank += "" if measure.rank_correlation >= LEAST_RANK else "  no"
        bias += "" if abs(measure.bias) <= MOST_BIAS else "  no"
        shown.add_row(measure.measure, f"{measure.spread_in_noise:.1f}", rank, bias)
    console.print(shown)
    effects = [effect for effect in transfer.effects if effect.counts]
    right = sum(effect.ratio > 0.0 for effect in effects)
    near = sum(abs(effect.ratio - 1.0) <= 0.25 for effect in effects)
    ratio = np.median([effect.ratio for effect in effects]) if effects else float("nan")
    in_surrogate, in_sumo = transfer.num_failed
    console.print(
        f"main effects beyond SUMO's noise: {len(effects)}; sign right in {right}, size within 25 % in {near}, "
        f"median ratio {ratio:.2f}; cases failed: {in_surrogate} in the surrogate, {in_sumo} in SUMO"
    )


def show_insertion(console: Console, rows: list[dict]) -> None:
    """Print shares of the vehicles that got in."""
    headings = ("input", "demand", "SUMO", "surrogate", f"difference <= {MOST_INSERTION_DIFFERENCE:.0%}")
    shown = _table("inserted / scheduled", headings)
    for row in rows:
        difference = row["surrogate_share"] - row["sumo_share"]
        verdict = "" if abs(difference) <= MOST_INSERTION_DIFFERENCE else "  no"
        shares = (f"{row['sumo_share']:.1%}", f"{row['surrogate_share']:.1%}")
        shown.add_row(row["input"], f"{row['demand_vehph']:.0f} veh/h", *shares, f"{difference:+.1%}{verdict}")
    console.print(shown)


def _table(title: str, headings: tuple[str, ...]) -> Table:
    shown = Table(title=title)
    for heading in headings:
        shown.add_column(heading)
    return shown


if __name__ == "__main__":
    app()
