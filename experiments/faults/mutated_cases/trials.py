"""Spoilt cases are checked, and some that pass are calibrated: no traceback, a line that names the file, few seconds.

Most are checked within a few long-lived processes, for an interpreter for each would take most of the time; every
fiftieth is checked by the command itself. Where the machine has more to do than its cores can, processor time is judged
instead of time by the clock.
"""

import multiprocessing
import os
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from itertools import islice
from pathlib import Path
from typing import Any

from pebble import ProcessExpired, ProcessPool

from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.commands import is_machine_busy, run_command
from experiments.faults.mutated_cases.checker import Checked, begin_checker, check
from experiments.faults.mutated_cases.spoiling import spoil_case
from experiments.faults.said import fault_of

LONGEST_CHECK_S, MOST_MEMORY_MB = 10.0, 1500.0
GIVEN_UP_S = 60.0  # a check that takes longer is killed
LONGEST_CALIBRATION_S = 900.0
COMMAND_EVERY = 50  # trials of which one is made by the command itself
CALIBRATED_EVERY = 10  # trials of which one is calibrated, if it passes the check
CHECKS_PER_PROCESS = 100
ELSEWHERE = ["passwd", "etc"]  # files that odd values name
AHEAD = 4  # cases per process that wait to be checked


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Spoil and check the cases of these numbers."""
    sound, num_processes = ground.case, len(os.sched_getaffinity(0))
    pool = ProcessPool(
        max_workers=num_processes,
        max_tasks=CHECKS_PER_PROCESS,
        context=multiprocessing.get_context("spawn"),
        initializer=begin_checker,
    )
    with pool:
        rest = iter(numbers)
        waiting = [_begun(ground, sound, pool, number) for number in islice(rest, AHEAD * num_processes)]
        while waiting:
            yield _finished(ground, *waiting.pop(0))
            waiting += [_begun(ground, sound, pool, number) for number in islice(rest, 1)]


Begun = tuple[int, str, list[str], Path, "Future[Any] | None"]


def _begun(ground: Ground, sound: Path, pool: ProcessPool, number: int) -> Begun:
    """Spoil a case and have it checked in the background; who is checked by the command is not begun yet."""
    case = ground.fresh(f"{number:05d}") / "case"
    words, files = spoil_case(sound, case, ground.chance(number))
    if number % COMMAND_EVERY == 0:
        return number, words, files, case, None
    page = case.with_name("check.html")
    return number, words, files, case, pool.schedule(check, args=(case, page), timeout=GIVEN_UP_S)


def _finished(
    ground: Ground, number: int, words: str, files: list[str], case: Path, future: "Future[Any] | None"
) -> Trial:
    known = [path.name for path in sorted(ground.case.rglob("*")) if path.is_file()] + files + ["case.toml"]
    known += [path.name for path in case.rglob("*")] + ELSEWHERE
    try:
        checked = _by_command(case) if future is None else future.result()
        wrong = _complaint_of(checked, known)
    except TimeoutError:
        checked, wrong = Checked(1, "", GIVEN_UP_S, 0.0, 0.0), f"it took more than {GIVEN_UP_S:.0f} s and was killed"
    except ProcessExpired as error:
        checked, wrong = Checked(1, "", 0.0, 0.0, 0.0), f"it took the process along: exit code {error.exitcode}"
    happened = checked.err.strip().splitlines()[0] if checked.err.strip() else "accepted"
    if not wrong and checked.code == 0 and number % CALIBRATED_EVERY == 0:
        wrong, happened = _calibrated(case, known)
    if not wrong:
        shutil.rmtree(case.parent)  # those that failed are kept, to be looked at
    how = "command" if future is None else "process"
    name = f"{words} (by {how})"
    ending = "failed" if wrong else "passed"
    return Trial(number, name, ending, in_one_line(wrong or happened), checked.wall_s, checked.peak_mb)


def _complaint_of(checked: Checked, known: Sequence[str]) -> str:
    if words := fault_of(checked.code, checked.err, may_say_more=True, files=known):
        return words
    if (checked.cpu_s if is_machine_busy() else checked.wall_s) > LONGEST_CHECK_S:
        return f"it took {checked.wall_s:.1f} s, of which the processor {checked.cpu_s:.1f} s"
    return f"it took {checked.peak_mb:.0f} MB" if checked.peak_mb > MOST_MEMORY_MB else ""


def _by_command(case: Path) -> Checked:
    ended = run_command("check", case, "--out", case.with_name("check.html"), longest_s=GIVEN_UP_S)
    if ended.is_late:
        raise TimeoutError
    return Checked(ended.code, ended.err, ended.wall_s, ended.cpu_s, ended.peak_mb)


def _calibrated(case: Path, known: Sequence[str]) -> tuple[str, str]:
    """Calibrate a case that passed; return what is wrong with how that ended, and what happened."""
    arguments = ("calibrate", case, "--out", case.with_name("run"), "--budget", "0.05", "--quiet")
    ended = run_command(*arguments, longest_s=LONGEST_CALIBRATION_S)
    wrong = fault_of(ended.code, ended.err, files=known, is_late=ended.is_late)
    happened = "calibrated" if ended.code == 0 else ended.last_words
    return wrong and f"in calibrate: {wrong}", f"accepted, then in {ended.wall_s:.0f} s: {happened}"


ATTACK = Attack(
    asks="spoilt logs, case.toml and SUMO files: no traceback, a line that names the file, at most 10 s and 1.5 GB",
    usual=500,
    trials=trials,
)
