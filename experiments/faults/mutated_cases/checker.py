"""A long-lived process that checks cases as the command does, and takes note of all that it says, time and memory."""

import os
import resource
import tempfile
import time
import traceback
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from experiments.faults.commands import peak_mb_of

STANDARD_OUTPUT, STANDARD_ERROR = 1, 2
MOST_DATA_BYTES = 6 << 30  # where a file takes more, the machine is kept from running out
RESET_PEAK = "5"  # of /proc/self/clear_refs
_start_s = _start_cpu_s = 0.0


@dataclass(frozen=True)
class Checked:
    """How a check ended."""

    code: int
    err: str  # all that was said on standard error, SUMO and libraries included
    wall_s: float  # as a user waits: with the start of an interpreter
    cpu_s: float  # processor time of the process and of those that it has started
    peak_mb: float


def begin_checker() -> None:
    """Import what checks need; the time counts for each of them, as a user's command would begin so."""
    global _start_s, _start_cpu_s
    began_s, began_cpu_s = time.perf_counter(), _cpu_s()
    import jaxcalib.check.check_page
    import jaxcalib.cli.app  # noqa: F401

    resource.setrlimit(resource.RLIMIT_DATA, (MOST_DATA_BYTES, MOST_DATA_BYTES))
    _start_s, _start_cpu_s = time.perf_counter() - began_s, _cpu_s() - began_cpu_s


def check(case: Path, page: Path) -> Checked:
    """Check a case, as `jaxcalib check CASE --out PAGE`."""
    from jaxcalib.cli import app

    Path("/proc/self/clear_refs").write_text(RESET_PEAK)
    before = [os.dup(place) for place in (STANDARD_OUTPUT, STANDARD_ERROR)]
    began_s, began_cpu_s = time.perf_counter(), _cpu_s()
    with tempfile.TemporaryFile("w+", errors="replace") as out, tempfile.TemporaryFile("w+", errors="replace") as err:
        os.dup2(out.fileno(), STANDARD_OUTPUT)
        os.dup2(err.fileno(), STANDARD_ERROR)
        try:
            with redirect_stdout(out), redirect_stderr(err):  # what is Python's own may have been led elsewhere before
                try:
                    code = app.check(case, out=page)
                except BaseException:
                    traceback.print_exc()
                    code = 1
                out.flush()
                err.flush()
            wall_s, cpu_s = time.perf_counter() - began_s, _cpu_s() - began_cpu_s
        finally:
            for place, one in zip((STANDARD_OUTPUT, STANDARD_ERROR), before, strict=True):
                os.dup2(one, place)
                os.close(one)
        err.seek(0)
        said = err.read()
    return Checked(code, said, _start_s + wall_s, _start_cpu_s + cpu_s, peak_mb_of("self"))


def _cpu_s() -> float:
    """Processor time of this process and of those of its own that have ended."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system
