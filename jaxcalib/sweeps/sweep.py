"""One call makes a sweep, or goes on with it, and leaves one table."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from jaxcalib.calibration.evaluator import interleaved_departs_s
from jaxcalib.disk import check_out, check_outside, writing_to
from jaxcalib.engines import prepare_devices
from jaxcalib.errors import CaseError, quote
from jaxcalib.parameter_space import ParameterSpace, parameter_space, round_values
from jaxcalib.problem import CalibrationProblem, read_problem
from jaxcalib.run_folder import identify
from jaxcalib.settings import Settings, read_settings
from jaxcalib.sweeps.columns import rows_of, sweep_schema
from jaxcalib.sweeps.description import describe, identity_options
from jaxcalib.sweeps.design import make_design
from jaxcalib.sweeps.local_engines import BlockEngine, local_engine
from jaxcalib.sweeps.merge import merge, missing_blocks, remove_blocks, rows_in
from jaxcalib.sweeps.plan import ENGINES, Engine, Shard, SweepPlan, read_shard
from jaxcalib.sweeps.progress import Silent, SweepProgress
from jaxcalib.sweeps.report import report_files, write_report
from jaxcalib.sweeps.store import SweepStore

SEEDS_PER_SWEEP = 1_000_000  # as for calibrations: no two values of --seed share a run's seed
MOST_SEED = 2_000
MOST_SEEDS = 100_000


@dataclass(frozen=True)
class SweepResult:
    """What a sweep has left.

    Attributes:
        path: the table; it is there once all rows are.
        num_rows: rows of the whole sweep.
        num_missing: rows that no job has made yet.
        num_made: rows made by this call.
        statuses: number of rows by status, of the whole table; empty until it is there.
        wall_s: computing time of this call.
        warnings: what a user should know.
    """

    path: Path
    num_rows: int
    num_missing: int
    num_made: int
    statuses: dict[str, int]
    wall_s: float
    warnings: tuple[str, ...] = ()

    @property
    def is_complete(self) -> bool:
        """Whether the table is there with all its rows."""
        return not self.num_missing and self.path.is_file()

    def table(self) -> pd.DataFrame:
        """Return all rows.

        Raises:
            FileNotFoundError: the table is not there yet.
        """
        return pq.ParquetFile(self.path).read().to_pandas()


def sweep(
    case: Path | str,
    out: Path | str,
    *,
    design: str = "sobol:1024",
    seeds: int = 4,
    engine: Engine = "surrogate",
    seed: int = 0,
    parameters: Sequence[str] | None = None,
    settings: Settings | Path | None = None,
    shard: Shard | str | None = None,
    cluster: str | None = None,
    resume: bool = False,
    progress: SweepProgress | None = None,
) -> SweepResult:
    """Run every candidate of a design on several seeds; go on with a sweep that was stopped.

    Args:
        case: the case's folder.
        out: the table to write, a name that ends in .parquet. Until it is complete, its blocks lie in a folder
            beside it, whose name ends in .parts.
        design: "sobol:N", "latin-hypercube:N", "grid:LEVELS", "orthogonal-array:LEVELS" or the path of a table.
        seeds: runs of each candidate, the same seeds for all.
        engine: "surrogate" or "sumo".
        seed: of all random numbers, 0 to 2000.
        parameters: names of those that vary, the others keep the scenario's values; None for all.
        settings: for bounds, or a TOML file of them.
        shard: part of the sweep that this call makes, for example "3/8"; None for all of it and the table.
        cluster: address of a dask scheduler whose workers make the runs; None for this machine.
        resume: insist on a sweep that was begun; without it one that is there is gone on with all the same.
        progress: told how far it is.

    Returns:
        What the sweep has left.

    Raises:
        CaseError: the case, the design or the files of the sweep are wrong; one line says what.
        ResourceError: the disk is full, or the cluster does not answer.
    """
    began = time.perf_counter()
    part = read_shard(shard) if isinstance(shard, str) else shard
    _check(engine, seeds, seed)
    table = _table_path(Path(out), Path(case))
    store = SweepStore(table)
    if resume and not store.is_begun:
        raise CaseError(table, "", "expected a sweep that was begun; there is none. Leave --resume out to begin one.")
    if not store.is_complete:
        check_out(table.parent)
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    chosen = settings if isinstance(settings, Settings) else read_settings(settings)
    space = _space(problem, chosen)
    base = round_values(problem.template.base_values())
    plan = SweepPlan(
        engine=engine,
        design=make_design(design, space, base, parameters, seed),
        num_seeds=seeds,
        first_seed=seed * SEEDS_PER_SWEEP,
        departs_s=tuple(interleaved_departs_s(problem.departs_s("fit"))),
    )
    schema = sweep_schema(space, problem.measures)
    identity = identify(problem.case, identity_options(plan, chosen))
    with store:
        description = store.begin(describe(problem, space, plan, chosen, schema, identity), identity)
        if store.is_complete:
            remove_blocks(store)
            if not all(file.is_file() for file in report_files(table)):  # stopped between the table and its report
                write_report(table, problem)
            return _result(store, description, 0, began, plan)
        store.claim(part or Shard())
        missing = [block for block in missing_blocks(store, description) if (part or Shard()).has(block)]
        to_make = sum(rows_in(description, block) for block in missing)
        progress = progress or Silent()
        progress.begin(rows_of_shard(description, part or Shard()), to_make)
        if missing:
            with writing_to(store.folder):
                runner = _runner(problem, engine, cluster, identity)
            try:
                with writing_to(store.folder):
                    for block, outcomes in runner.outcomes(plan, missing):
                        store.write(block, rows_of(
                            schema, space, problem.measures, problem.tally_names, engine, plan.candidates(block),
                            outcomes,
                        ))  # fmt: skip
                        progress.rows(len(outcomes), sum(not outcome.status.is_ok for outcome in outcomes))
            finally:
                runner.close()
        if part is None:
            merge(store, description)
            write_report(table, problem)
    return _result(store, description, to_make, began, plan)


def merge_shards(out: Path | str, case: Path | str | None = None) -> SweepResult:
    """Make one table of what several jobs have made, once nothing is missing.

    Args:
        out: the table, as in the jobs.
        case: the case's folder, for the field's values in the figures; None leaves them out.

    Raises:
        CaseError: a job is at work, rows are missing, or the sweep is of another case.
        ResourceError: the disk is full.
    """
    began = time.perf_counter()
    table = Path(out)
    store = SweepStore(table)
    if not store.is_begun:
        raise CaseError(table, "", "expected a sweep that was begun; there is none.")
    if not store.is_complete:
        check_out(table.parent)
    problem = None if case is None else read_problem(case)
    description = store.description()
    if problem is not None:
        found = identify(problem.case, {})["case"]
        if found != description["identity"].get("case"):
            raise CaseError(table, "case", f"expected the case that this sweep was begun with, {description['case']}.")
    if not store.is_complete:
        with store:
            store.claim_all()
            merge(store, description)
    remove_blocks(store)
    write_report(table, problem)
    return _result(store, description, 0, began, None)


def rows_of_shard(description: dict[str, Any], shard: Shard) -> int:
    """Return the number of rows that a job has to make in all."""
    return sum(rows_in(description, block) for block in range(int(description["num_blocks"])) if shard.has(block))


def _runner(problem: CalibrationProblem, engine: Engine, cluster: str | None, identity: dict[str, str]) -> BlockEngine:
    if cluster is None:
        return local_engine(problem, engine)
    try:
        from jaxcalib.sweeps.cluster import ClusterEngine
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("distributed", "dask"):
            raise
        raise CaseError("command line", "--cluster", "expected dask; pip install 'jaxcalib[cluster]'.") from None
    return ClusterEngine(cluster, problem, engine, identity)


def _result(
    store: SweepStore, description: dict[str, Any], num_made: int, began: float, plan: SweepPlan | None
) -> SweepResult:
    statuses: dict[str, int] = {}
    missing = 0
    if store.is_complete:
        column = pq.ParquetFile(store.table).read(["status"])["status"].to_pandas()
        statuses = {str(name): int(count) for name, count in column.value_counts().items() if count}
    else:
        missing = sum(rows_in(description, block) for block in missing_blocks(store, description))
    return SweepResult(
        path=store.table,
        num_rows=int(description["num_rows"]),
        num_missing=missing,
        num_made=num_made,
        statuses=statuses,
        wall_s=time.perf_counter() - began,
        warnings=() if plan is None else plan.design.warnings,
    )


def _check(engine: str, seeds: int, seed: int) -> None:
    if engine not in ENGINES:
        raise CaseError("command line", "--engine", f"expected one of {', '.join(ENGINES)}; got {quote(engine)}.")
    if not 1 <= seeds <= MOST_SEEDS:
        raise CaseError("command line", "--seeds", f"expected 1 to {MOST_SEEDS}, got {seeds}.")
    if not 0 <= seed <= MOST_SEED:
        raise CaseError("command line", "--seed", f"expected 0 to {MOST_SEED}, got {seed}.")


def _table_path(out: Path, case: Path) -> Path:
    if out.suffix.lower() != ".parquet":
        raise CaseError("command line", "--out", f"expected a name that ends in .parquet, got {quote(out.name)}.")
    check_outside(out, case)
    with writing_to(out):
        if out.is_dir():
            raise CaseError(out, "", "expected the name of a table, got a folder.")
    return out


def _space(problem: CalibrationProblem, settings: Settings) -> ParameterSpace:
    """Return the bounds: inflows around the scenario's, driver parameters as in calibrations."""
    demand = problem.template.base_demand_vehph()
    return parameter_space(
        problem.layout, problem.model, np.asarray(demand, float), settings.scaling_factor, settings.bounds
    )
