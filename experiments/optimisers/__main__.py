"""`python -m experiments.optimisers`: which optimiser wins, for equal simulations and for equal time."""

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from experiments.optimisers.case_problem import CaseProblem, PreparedCase, prepare_case
from experiments.optimisers.course import Budget, Problem, run_course
from experiments.optimisers.figures import draw_courses, draw_ranks
from experiments.optimisers.known_functions import FUNCTIONS, NOISE, FunctionProblem
from experiments.optimisers.ranking import all_rank_tables, summary_table
from experiments.optimisers.registry import OPTIMISERS, chosen_optimisers
from experiments.optimisers.study_folder import open_study, write_table
from experiments.results.record import record as keep
from jaxcalib.cli.guarded import guarded
from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import prepare_devices
from jaxcalib.problem.problem import read_problem
from jaxcalib.runs.run_folder import identify

MOST_TIMED_SHARE = 20  # times the evaluations of the other part: an end for searches whose candidates cost nothing
app = App(name="experiments.optimisers", help="Which optimiser finds the best parameters.")
Frame = Any  # a data frame; what is taken from one is untyped anyway
AtLeastOne = Parameter(validator=Number(gte=1))


@dataclass(frozen=True)
class Course:
    """One search to be made."""

    optimiser: str
    problem: Problem
    budget: Budget
    journal: Path


@app.default
def optimisers(
    case: Path | None = None,
    /,
    *,
    out: Path = Path("optimisers"),
    optimiser: tuple[str, ...] = (),
    seeds: Annotated[int, AtLeastOne] = 10,
    evaluations: Annotated[int, Parameter(validator=Number(gte=2))] = 200,
    batch: Annotated[int, Parameter(validator=Number(gte=2))] = 8,
    wall_s: Annotated[float, Parameter(validator=Number(gte=0))] = 0.0,
    functions: bool = True,
    dimensions: Annotated[int, Parameter(validator=Number(gte=2))] = 5,
    resume: bool = False,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Compare optimisers on a case and on functions whose optimum is known.

    Parameters
    ----------
    case
        Case to search in the surrogate; without it, functions only.
    out
        Folder for journals, tables and figures.
    optimiser
        Optimisers to compare, the option once for each; all by default.
    seeds
        Searches of each optimiser on each problem.
    evaluations
        Candidates of each search.
    batch
        Candidates that optimisers may evaluate together.
    wall_s
        Search the case for equal time as well, so many seconds each; 0 leaves that out.
    functions
        Whether to compare on functions.
    dimensions
        Parameters of the functions.
    resume
        Go on with what the folder holds; more seeds, optimisers or functions may be added.
    record
        Also write the table to experiments/results.
    """
    console = Console(stderr=True)

    def work() -> str:
        rows = _study(console, case, out, optimiser, seeds, evaluations, batch, wall_s, functions, dimensions, resume)
        if record:
            name = "functions" if case is None else case.resolve().name
            keep("optimisers", name, rows.to_dict("records"), f"{evaluations} candidates, {seeds} seeds: {name}")
        return ""

    return guarded(work, "go on with the same command and --resume", program="experiments.optimisers")


def _study(
    console: Console,
    case: Path | None,
    out: Path,
    names: tuple[str, ...],
    num_seeds: int,
    num_evaluations: int,
    batch: int,
    wall_s: float,
    functions: bool,
    dimensions: int,
    resume: bool,
) -> Frame:
    chosen = chosen_optimisers(names)
    if case is None and not functions:
        raise CaseError("--no-functions", "", "expected a case; without functions there is nothing to search.")
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = None if case is None else read_problem(case)
    identity = None if problem is None else identify(problem.case, {}, (Path(__file__).parent,))
    configuration: dict[str, Any] = {
        "case": identity and identity["case"],
        "program": identity and identity["program"],
        "optimisers": chosen,
        "seeds": list(range(num_seeds)),
        "evaluations": num_evaluations,
        "batch": batch,
        "wall_s": wall_s,
        "functions": list(FUNCTIONS) if functions else [],
        "dimensions": dimensions,
    }
    with open_study(out, configuration, resume):
        prepared = None
        if problem is not None:
            with console.status("initial values from the logs, and the surrogate's compilation"):
                prepared = prepare_case(problem)
        budget = Budget(num_evaluations, batch_size=batch)
        courses = list(_courses(chosen, prepared, out, range(num_seeds), budget, wall_s, functions, dimensions))
        rows: list[dict[str, Any]] = []
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
            task = bar.add_task("searches", total=len(courses))
            for course in courses:
                bar.update(task, description=f"{course.problem.name} {course.optimiser}")
                rows += run_course(
                    course.optimiser, OPTIMISERS[course.optimiser], course.problem, course.budget, course.journal
                )
                bar.advance(task)
        return _write_results(pd.DataFrame(rows), out)


def _courses(
    chosen: tuple[str, ...],
    prepared: PreparedCase | None,
    out: Path,
    seeds: range,
    budget: Budget,
    wall_s: float,
    functions: bool,
    dimensions: int,
) -> Iterator[Course]:
    """Yield all searches, seed by seed, so that a stopped study has whole blocks."""
    for seed in seeds:
        problems: list[Problem] = []
        if functions:
            problems.extend(FunctionProblem(name, variant, dimensions, seed) for name in FUNCTIONS for variant in NOISE)
        for problem in problems:
            yield from _of_problem(chosen, problem, budget, out / "journal")
        if prepared is not None:
            yield from _of_problem(chosen, CaseProblem(prepared, seed), budget, out / "journal")
            if wall_s > 0.0:
                # who plans ahead plans for as many as without the clock: how many that allows is not known before
                most = MOST_TIMED_SHARE * budget.num_evaluations
                timed = Budget(most, wall_s, budget.batch_size, budget.num_evaluations)
                yield from _of_problem(chosen, CaseProblem(prepared, seed), timed, out / "journal_wall_time")


def _of_problem(chosen: tuple[str, ...], problem: Problem, budget: Budget, journal: Path) -> Iterator[Course]:
    for name in chosen:
        yield Course(name, problem, budget, journal / problem.name / f"{name}-{problem.seed}")


def _write_results(rows: Frame, out: Path) -> Frame:
    """Write tables and figures; return ranks with the errors at the end of the searches."""
    summary: Frame = summary_table(rows)
    ranks: Frame = all_rank_tables(rows)
    for name, table in (("rows", rows), ("summary", summary), ("ranks", ranks)):
        write_table(table, out, name)
    for budget in dict.fromkeys(rows["budget"]):
        draw_courses(summary, budget, out / f"error_against_{budget}.svg")
        draw_ranks(ranks[ranks["budget"] == budget], out / f"ranks_{budget}.svg")
    last = summary[summary["share"] == summary["share"].max()]
    keys = ["budget", "problem", "optimiser"]
    ranked = ranks.merge(last[[*keys, "median", "low", "high"]], on=keys, how="left")
    _show(Console(), ranked)
    print(f"written: {out}", file=sys.stderr)
    return ranked


def _show(console: Console, ranked: Frame) -> None:
    for (budget, problem), group in ranked.groupby(["budget", "problem"], sort=False):
        friedman = group["friedman_p"].iloc[0]
        shown = Table(title=f"{problem}, equal {str(budget).replace('_', ' ')} (Friedman p = {friedman:.2g})")
        for heading in ("optimiser", "mean rank", "p against the first", "median error", "95 % interval"):
            shown.add_column(heading)
        for row in group.itertuples():
            p_value = "" if pd.isna(row.p_value) else f"{row.p_value:.2g}"
            is_known = not pd.isna(row.median)
            errors = (f"{row.median:.3g}", f"{row.low:.3g} to {row.high:.3g}") if is_known else ("", "")
            shown.add_row(str(row.optimiser), f"{row.mean_rank:.1f}", p_value, *errors)
        console.print(shown)


if __name__ == "__main__":
    sys.exit(app())
