"""SUMO's workers crash, hang or answer garbage, in one job of twenty and in all of them.

Whoever crashes or hangs once is tried again, so the result is the undisturbed one; where all do, one line says so.
Garbage is no result: its row of a sweep says that it failed, and all others are what they were.
"""

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from experiments.faults.altered import MODULE, Alterations
from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.broken_answers import HOW
from experiments.faults.broken_jobs import BREAKING, GARBAGE
from experiments.faults.commands import POLL_S, Ended, Started, run_command, state_of
from experiments.faults.said import fault_of_ended
from experiments.faults.small_commands import COMMANDS, difference, differing_rows, reference_of, statuses

ONE_IN, ALL = 20, 1
LONGEST_RUN_S = 4.0
SPARE_S = 2.0  # after which whoever hangs is dead
LONGEST_S, LONGEST_CHECK_S = 1800.0, 120.0
CHECK = "check"
QUESTIONS = ("loading", "first run")


@dataclass(frozen=True)
class Plan:
    """What is done in a trial."""

    command: str  # name in `COMMANDS`, or check
    how: str  # what befalls jobs, or how a question is answered
    every: int = ALL  # jobs of which one is befallen
    question: str = ""  # which of the questions of a check is answered so

    @property
    def name(self) -> str:
        """The trial's name."""
        what = self.question or ("all jobs" if self.every == ALL else f"1 of {self.every} jobs")
        return f"{self.command}: {self.how} in {what}"


PLANS = (
    *(Plan("sweep in SUMO", how, every) for every, how in product((ONE_IN, ALL), (*BREAKING, *GARBAGE))),
    *(Plan("calibrate", how, every) for how, every in product(("segfault", "hang", "no numbers"), (ONE_IN, ALL))),
    *(Plan(CHECK, how, question=question) for question, how in product(QUESTIONS, HOW)),
)


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials of these numbers."""
    for number in numbers:
        plan, folder = PLANS[number], ground.fresh(f"{number:05d}")
        if plan.command == CHECK:
            ended, wrong, happened = _with_broken_answers(ground, plan, folder)
        else:
            first = int(ground.chance(number).integers(plan.every))
            ended, wrong, happened = _with_broken_jobs(ground, plan, folder, first)
        ending = "failed" if wrong else "passed"
        yield Trial(number, plan.name, ending, in_one_line(wrong or happened), ended.wall_s, ended.peak_mb)


def _with_broken_answers(ground: Ground, plan: Plan, folder: Path) -> tuple[Ended, str, str]:
    """Check the case while one of SUMO's questions is answered wrongly."""
    altered = Alterations(question=plan.question, answer=plan.how, longest_run_s=LONGEST_RUN_S)
    file = altered.write(folder / "alterations.json")
    arguments = (file, CHECK, ground.case, "--out", folder / "check.html")
    ended = run_command(*arguments, program=MODULE, longest_s=LONGEST_CHECK_S)
    return ended, fault_of_ended(ended), "done" if ended.code == 0 else ended.last_words


def _with_broken_jobs(ground: Ground, plan: Plan, folder: Path, first: int) -> tuple[Ended, str, str]:
    """Run a command while jobs are befallen, and compare what it leaves."""
    command, reference = COMMANDS[plan.command], reference_of(ground, plan.command)
    altered = Alterations(
        job=plan.how, every=plan.every, first=first, notes=str(folder), longest_run_s=LONGEST_RUN_S, cores=1
    )
    file = altered.write(folder / "alterations.json")
    started = Started([file, *command.words(ground.case, folder / "run")], program=MODULE)
    longest_alive_s = _look_on(started, folder)
    ended = started.wait(LONGEST_S)
    befallen = len(list(folder.glob("befallen-*.json")))
    happened = f"{befallen} jobs befallen"
    if not befallen:
        return ended, "no job was befallen", ""
    if longest_alive_s > LONGEST_RUN_S + SPARE_S:
        return ended, f"whoever hung lived for {longest_alive_s:.1f} s", happened
    if plan.how == "hang":
        happened += f", dead after {longest_alive_s:.1f} s of {LONGEST_RUN_S:.0f}"
    if wrong := fault_of_ended(ended):
        return ended, wrong, happened
    if ended.code:
        # a line is an answer where all fail; not where a run that died has only to be made again
        wrong = ended.last_words if plan.every == ONE_IN and plan.how in BREAKING else ""
        return ended, wrong, f"{happened}; {ended.last_words}"
    result = command.result(folder / "run")
    if plan.how in BREAKING:
        wrong = difference(result, reference.result) if plan.every == ONE_IN else "it ended well, without a run"
        return ended, wrong, f"{happened}; result equal"
    if not command.is_table:
        return ended, _garbage_in(folder, plan), f"{happened}; a result"
    rows = differing_rows(result, reference.result)
    if "columns" in rows or len(rows) > befallen:
        return ended, f"{len(rows)} rows differ, and {befallen} were befallen", happened
    if "OK" in (found := statuses(result, rows)):
        return ended, f"garbage was taken for a run: {rows}", happened
    return ended, "", f"{happened}; their rows say {', '.join(sorted(found)) or 'what they did before'}"


def _garbage_in(folder: Path, plan: Plan) -> str:
    """Return what is wrong with a calibration whose jobs answered garbage; failures have to be counted."""
    if plan.every == ALL:
        return "it ended well, without a run"
    health = json.loads((folder / "run" / "result.json").read_text(encoding="utf-8"))["health"]
    return "" if any(one["failed"] for one in health.values()) else "its result counts no run that failed"


def _look_on(started: Started, folder: Path) -> float:
    """Look on while a command goes on; return how long befallen jobs' processes lived at most, where they hung."""
    longest_s = 0.0
    alive: dict[int, float] = {}
    seen: set[str] = set()
    while started.poll() is None and started.elapsed_s < LONGEST_S:
        for note in folder.glob("befallen-*.json"):
            if note.name not in seen:
                seen.add(note.name)
                content = json.loads(note.read_text(encoding="utf-8"))
                if content["how"] == "hang":
                    alive[content["process"]] = content["began_s"]
        for process, began_s in list(alive.items()):
            state = state_of(process)
            longest_s = max(longest_s, time.time() - began_s)
            if state is None or state[0] == "Z":
                del alive[process]
        time.sleep(POLL_S)
    return longest_s


ATTACK = Attack(
    asks="SUMO's workers crash, hang or answer garbage, 1 of 20 or all: same result or one line, dead at limit + 2 s",
    usual=len(PLANS),
    most=len(PLANS),
    trials=trials,
)
