"""One call makes a sweep, or goes on with it, and leaves one table."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq

from jaxcalib.cluster.opening import connect
from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.problem import read_problem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.disk import check_out, check_outside, writing_to
from jaxcalib.runs.progress import Silent
from jaxcalib.runs.run_folder import identify
from jaxcalib.runs.sweep_progress import SweepProgress
from jaxcalib.sweeps.local_engines import BlockEngine, local_engine
from jaxcalib.sweeps.merge import merge, missing_blocks, remove_blocks, rows_in
from jaxcalib.sweeps.options import SweepOptions
from jaxcalib.sweeps.plan import Engine, Shard
from jaxcalib.sweeps.preparation import PreparedSweep, prepare_sweep
from jaxcalib.sweeps.report import report_files, write_report
from jaxcalib.sweeps.store import SweepStore


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
    options = SweepOptions(
        design=design, seeds=seeds, engine=engine, seed=seed, parameters=parameters, settings=settings, shard=shard,
        cluster=cluster, resume=resume,
    )  # fmt: skip
    return make_sweep(case, out, options, progress or Silent())


def make_sweep(case: Path | str, out: Path | str, options: SweepOptions, progress: SweepProgress) -> SweepResult:
    """Make what is missing of a sweep, and the table if all rows are this call's to make; see `sweep`."""
    began = time.perf_counter()
    options.check()
    store = SweepStore(_table_path(Path(out), Path(case)))
    if options.resume and not store.is_begun:
        expected = "expected a sweep that was begun; there is none. Leave --resume out to begin one."
        raise CaseError(store.table, "", expected)
    if not store.is_complete:
        check_out(store.table.parent)
    prepared = prepare_sweep(case, options)
    with store:
        description = store.begin(prepared.description(), prepared.identity)
        num_made = 0
        if store.is_complete:
            remove_blocks(store)
            if not all(file.is_file() for file in report_files(store.table)):  # stopped between table and report
                write_report(store.table, prepared.problem)
        else:
            store.claim(options.part)
            num_made = _make_rows(store, prepared, description, options, progress)
            if options.is_whole:
                merge(store, description)
                write_report(store.table, prepared.problem)
    return _result(store, description, num_made, began, prepared.plan.design.warnings)


def _make_rows(
    store: SweepStore,
    prepared: PreparedSweep,
    description: dict[str, Any],
    options: SweepOptions,
    progress: SweepProgress,
) -> int:
    """Make the runs that are missing of a part, and keep their rows; return how many there were."""
    part = options.part
    missing = [block for block in missing_blocks(store, description) if part.has(block)]
    to_make = sum(rows_in(description, block) for block in missing)
    progress.begin(rows_of_shard(description, part), to_make)
    if not missing:
        return 0
    with writing_to(store.folder):
        runner = _runner(prepared, options.cluster)
    try:
        with writing_to(store.folder):
            for block, outcomes in runner.outcomes(prepared.plan, missing):
                store.write(block, prepared.rows(block, outcomes))
                progress.rows(len(outcomes), sum(not outcome.status.is_ok for outcome in outcomes))
    finally:
        runner.close()
    return to_make


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
    return _result(store, description, 0, began)


def rows_of_shard(description: dict[str, Any], shard: Shard) -> int:
    """Return the number of rows that a job has to make in all."""
    return sum(rows_in(description, block) for block in range(int(description["num_blocks"])) if shard.has(block))


def _runner(prepared: PreparedSweep, cluster: str | None) -> BlockEngine:
    if cluster is None:
        return local_engine(prepared.problem, prepared.plan.engine)
    connection = connect(cluster)
    from jaxcalib.sweeps.cluster import ClusterEngine  # dask may not be installed

    return ClusterEngine(connection, prepared.problem, prepared.plan.engine, prepared.identity)


def _result(
    store: SweepStore, description: dict[str, Any], num_made: int, began: float, warnings: tuple[str, ...] = ()
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
        warnings=warnings,
    )


def _table_path(out: Path, case: Path) -> Path:
    if out.suffix.lower() != ".parquet":
        raise CaseError("command line", "--out", f"expected a name that ends in .parquet, got {quote(out.name)}.")
    check_outside(out, case)
    with writing_to(out):
        if out.is_dir():
            raise CaseError(out, "", "expected the name of a table, got a folder.")
    return out
