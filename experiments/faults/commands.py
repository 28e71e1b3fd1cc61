"""Commands of the program as processes of their own: started, killed, waited for, with time and memory taken."""

import atexit
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.faults.attack import environment

POLL_S = 0.02
LOOK_S = 1.0  # between two looks at all processes of a group
KILOBYTES_PER_MEGABYTE = 1024
PROGRAM = ("-m", "jaxcalib")
SAID = ("out", "err")  # files of what it says


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int  # its exit code; negative for a signal
    out: str  # what it said on standard output
    err: str  # and on standard error
    wall_s: float
    cpu_s: float  # processor time of all its processes
    peak_mb: float  # most memory of one of them
    is_late: bool = False  # killed, because it took longer than it may

    @property
    def last_words(self) -> str:
        """The last line that it said on standard error, or else on standard output."""
        lines = [line for text in (self.out, self.err) for line in text.splitlines() if line.strip()]
        return lines[-1] if lines else ""


class Started:
    """A command that goes on in a process group of its own."""

    def __init__(
        self,
        arguments: Sequence[str | Path],
        *,
        program: Sequence[str] = PROGRAM,
        cwd: Path | None = None,
        more: Mapping[str, str] | None = None,
    ) -> None:
        """Start it.

        Args:
            arguments: the command's.
            program: arguments of the interpreter before them.
            cwd: where it is started.
            more: variables of its environment.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="faults-")
        out, err = (Path(self._folder.name) / name for name in SAID)
        self._began_s = time.monotonic()
        with out.open("wb") as to_out, err.open("wb") as to_err:
            self._process = subprocess.Popen(
                [sys.executable, *program, *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=to_out,
                stderr=to_err, start_new_session=True, cwd=cwd, env=environment(**(more or {})),
            )  # fmt: skip
        self._ended: Ended | None = None
        atexit.register(self._end_with_parent)
        self._peak_mb = self._next_look_s = 0.0

    @property
    def process(self) -> int:
        """Number of the process, and of its group."""
        return self._process.pid

    @property
    def elapsed_s(self) -> float:
        """Time since the start."""
        return time.monotonic() - self._began_s

    def poll(self) -> Ended | None:
        """Return how it ended; None while it goes on."""
        if self._ended is None:
            self._look_at_memory()
            process, status, used = os.wait4(self.process, os.WNOHANG)
            if process:
                self._end(status, used, is_late=False)
        return self._ended

    def _look_at_memory(self) -> None:
        """Take note of the most memory of one of its processes by now.

        What the system says of a process that has ended includes the memory of the one that started it.
        """
        processes = [self.process]
        if self.elapsed_s > self._next_look_s:
            self._next_look_s = self.elapsed_s + LOOK_S
            processes += processes_of_group(self.process)
        self._peak_mb = max(self._peak_mb, *map(peak_mb_of, processes))

    def kill(self) -> Ended:
        """Kill the whole process group without warning, if it goes on, and return how it ended."""
        return self._kill(is_late=False)

    def wait(self, longest_s: float) -> Ended:
        """Wait for the end; whatever takes longer is killed."""
        while (ended := self.poll()) is None:
            if self.elapsed_s > longest_s:
                return self._kill(is_late=True)
            time.sleep(POLL_S)
        return ended

    def _end_with_parent(self) -> None:
        """End with whoever has started it, where that is stopped."""
        if self._ended is None:
            self.kill()

    def _kill(self, is_late: bool) -> Ended:
        if (ended := self.poll()) is not None:
            return ended
        os.killpg(self.process, signal.SIGKILL)
        _, status, used = os.wait4(self.process, 0)
        return self._end(status, used, is_late)

    def _end(self, status: int, used: resource.struct_rusage, is_late: bool) -> Ended:
        atexit.unregister(self._end_with_parent)
        self._process.returncode = os.waitstatus_to_exitcode(status)  # it must not be waited for again
        with self._folder as folder:
            texts = [(Path(folder) / name).read_text(encoding="utf-8", errors="replace") for name in SAID]
        self._ended = Ended(
            self._process.returncode, *texts, wall_s=self.elapsed_s, cpu_s=used.ru_utime + used.ru_stime,
            peak_mb=self._peak_mb, is_late=is_late,
        )  # fmt: skip
        return self._ended


def run_command(
    *arguments: str | Path,
    longest_s: float,
    program: Sequence[str] = PROGRAM,
    cwd: Path | None = None,
    more: Mapping[str, str] | None = None,
) -> Ended:
    """Start a command and wait for its end; see `Started`."""
    return Started(arguments, program=program, cwd=cwd, more=more).wait(longest_s)


def is_machine_busy() -> bool:
    """Whether more work waits for this machine's cores than they can do, so that times by the clock say little."""
    return os.getloadavg()[0] > (os.cpu_count() or 1)


def peak_mb_of(process: int | str) -> float:
    """Return the most memory that a process had; 0 where there is none any more."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return 0.0
    found = (float(line.split()[1]) for line in lines if line.startswith("VmHWM"))
    return next(found, 0.0) / KILOBYTES_PER_MEGABYTE


def processes_of_group(group: int) -> list[int]:
    """Return the processes of a group or session that are alive."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            state = state_of(int(entry.name))
            if state is not None and group in state[1:] and state[0] != "Z":
                found.append(int(entry.name))
    return found


def state_of(process: int) -> tuple[str, int, int] | None:
    """Return state letter, process group and session of a process; None where there is none."""
    try:
        words = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return words[0], int(words[2]), int(words[3])
