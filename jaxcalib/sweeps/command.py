"""`jaxcalib sweep` as a person meets it: messages, exit codes, what to do next."""

import shlex
import signal
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import pyarrow.parquet as pq

from jaxcalib.calibration.evaluator import AllRunsFailedError
from jaxcalib.errors import CaseError
from jaxcalib.guarded import guarded
from jaxcalib.sweeps.plan import Engine
from jaxcalib.sweeps.progress import Silent, TerminalSweepProgress
from jaxcalib.sweeps.sweep import SweepResult, merge_shards, sweep
from sim_adapters.interface import Status


@dataclass(frozen=True)
class SweepOptions:
    """What stands on the command line."""

    case: Path | None
    out: Path
    design: str
    seeds: int
    engine: Engine
    seed: int
    parameters: tuple[str, ...] | None
    settings: Path | None
    shard: str | None
    merge: bool
    cluster: str | None
    resume: bool
    quiet: bool


def run_sweep(options: SweepOptions) -> int:
    """Make a sweep and return the exit code."""
    progress = Silent() if options.quiet else TerminalSweepProgress()

    def work() -> str:
        with progress if isinstance(progress, TerminalSweepProgress) else nullcontext():
            result = _made(options, progress)
        _refuse_all_failed(result)
        return "" if options.quiet else _summary(options, result)

    before = signal.signal(signal.SIGTERM, _stop)  # batch systems send it before they kill
    try:
        return guarded(work, f"go on with: {shlex.join(['jaxcalib', *sys.argv[1:]])}")
    finally:
        signal.signal(signal.SIGTERM, before)


def _made(options: SweepOptions, progress: Silent | TerminalSweepProgress) -> SweepResult:
    if options.merge:
        if options.shard is not None or options.cluster is not None:
            raise CaseError("command line", "--merge", "expected neither --shard nor --cluster beside it.")
        return merge_shards(options.out, options.case)
    if options.case is None:
        raise CaseError("command line", "CASE", "expected the folder of a case.")
    return sweep(
        options.case, options.out, design=options.design, seeds=options.seeds, engine=options.engine,
        seed=options.seed, parameters=options.parameters, settings=options.settings, shard=options.shard,
        cluster=options.cluster, resume=options.resume, progress=progress,
    )  # fmt: skip


def _refuse_all_failed(result: SweepResult) -> None:
    """Refuse a sweep, whose table is kept, without a single run to look at.

    Raises:
        AllRunsFailedError: all runs failed.
    """
    if result.is_complete and not result.statuses.get(Status.OK.name):
        (first,) = next(pq.ParquetFile(result.path).iter_batches(1, columns=["status", "log_tail"])).to_pylist()
        counts = ", ".join(f"{count} {name}" for name, count in result.statuses.items())
        words = first["log_tail"] or Status[first["status"]].value
        raise AllRunsFailedError(f"all {result.num_rows} runs failed ({counts}), see {result.path}", words)


def _summary(options: SweepOptions, result: SweepResult) -> str:
    lines = [f"warning: {line}" for line in result.warnings]
    if result.is_complete:
        counts = ", ".join(f"{count} {name}" for name, count in result.statuses.items())
        lines.append(f"{result.num_rows} runs ({counts}): {result.path}")
        lines.append(f"report: {result.path.with_suffix('.html')}")
    else:
        lines.append(f"shard {options.shard}: done; {result.num_missing} of {result.num_rows} runs are missing still.")
        lines.append(f"when all are there: jaxcalib sweep {options.case} --out {result.path} --merge")
    return "\n".join(lines)


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
