"""`jaxcalib sweep` as a person meets it: messages, exit codes, what to do next."""

import signal
from pathlib import Path
from types import FrameType

import pyarrow.parquet as pq

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.cli.guarded import guarded, to_go_on
from jaxcalib.cli.profile_table import print_profile
from jaxcalib.errors import CaseError
from jaxcalib.runs.profile import profiled
from jaxcalib.runs.progress import Silent
from jaxcalib.runs.sweep_progress import TerminalSweepProgress
from jaxcalib.sweeps.options import SweepOptions
from jaxcalib.sweeps.sweep import SweepResult, make_sweep, merge_shards
from sim_adapters.interface import Status


def run_sweep(case: Path | None, out: Path, options: SweepOptions, *, merge: bool, profile: bool, quiet: bool) -> int:
    """Make a sweep, or the table of what jobs have made, and return the exit code."""

    def work() -> str:
        if merge and (options.shard is not None or options.cluster is not None):
            raise CaseError("command line", "--merge", "expected neither --shard nor --cluster beside it.")
        if case is None and not merge:
            raise CaseError("command line", "CASE", "expected the folder of a case.")
        with profiled(profile), Silent() if quiet else TerminalSweepProgress() as progress:
            result = merge_shards(out, case) if merge or case is None else make_sweep(case, out, options, progress)
            print_profile()
        _refuse_all_failed(result)
        return "" if quiet else _summary(case, options, result)

    before = signal.signal(signal.SIGTERM, _stop)  # batch systems send it before they kill
    try:
        return guarded(work, to_go_on())
    finally:
        signal.signal(signal.SIGTERM, before)


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


def _summary(case: Path | None, options: SweepOptions, result: SweepResult) -> str:
    lines = [f"warning: {line}" for line in result.warnings]
    if result.is_complete:
        counts = ", ".join(f"{count} {name}" for name, count in result.statuses.items())
        lines.append(f"{result.num_rows} runs ({counts}): {result.path}")
        lines.append(f"report: {result.path.with_suffix('.html')}")
    else:
        lines.append(f"shard {options.shard}: done; {result.num_missing} of {result.num_rows} runs are missing still.")
        lines.append(f"when all are there: jaxcalib sweep {case} --out {result.path} --merge")
    return "\n".join(lines)


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
