"""Ten calibrations are started at once on one RUN: one works, the others say so, and no lock stays behind."""

import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.commands import Ended, Started, run_command
from experiments.faults.said import fault_of_ended

NUM_STARTS = 10
LONGEST_S = 1800.0
MOST_DELAY_S = 6.0
IN_USE = "another run goes on in it"
BEGUN = "a run was begun in this folder"


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials: all at the same moment on a new RUN, one after the other, all going on with a killed one."""
    for number in numbers:
        run = ground.fresh(f"{number:05d}") / "run"
        chance = ground.chance(number)
        is_begun, is_spread = number % 3 == 2, number % 3 == 1
        delays_s = sorted(chance.uniform(0.0, MOST_DELAY_S if is_spread else 0.0, NUM_STARTS))
        arguments = ("calibrate", ground.case, "--out", run, "--budget", "0.05", "--quiet")
        if is_begun:
            _begin(arguments, run)
            arguments = (*arguments, "--resume")
        began_s = time.monotonic()
        started = []
        for delay_s in delays_s:
            time.sleep(max(0.0, began_s + delay_s - time.monotonic()))
            started.append(Started(arguments))
        ended = [each.wait(LONGEST_S) for each in started]
        wall_s = time.monotonic() - began_s
        wrong = _complaint_of(ended, run) or _stale_lock(arguments, run)
        kind = "spread over seconds" if is_spread else "on one that was killed" if is_begun else "at the same moment"
        yield Trial(
            number,
            f"{NUM_STARTS} starts {kind}",
            "failed" if wrong else "passed",
            in_one_line(wrong or f"one worked, {NUM_STARTS - 1} were refused; the lock was free afterwards"),
            wall_s,
            max(each.peak_mb for each in ended),
        )


def _begin(arguments: Sequence[str | Path], run: Path) -> None:
    """Begin a RUN and kill it as soon as it has made runs."""
    first = Started(arguments)
    while first.poll() is None and not list((run / "journal").glob("part-*")):
        time.sleep(0.05)
    first.kill()


def _complaint_of(ended: Sequence[Ended], run: Path) -> str:
    for one in ended:
        if wrong := fault_of_ended(one):
            return wrong
    worked = [one for one in ended if one.code == 0]
    if len(worked) != 1:
        return f"{len(worked)} worked"
    for one in ended:
        if one.code and IN_USE not in one.err and BEGUN not in one.err:
            return f"refused for another reason: {one.last_words}"
    try:
        json.loads((run / "result.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        return f"no result: {error}"
    return ""


def _stale_lock(arguments: Sequence[str | Path], run: Path) -> str:
    """Go on with RUN, which finds all its runs made and gives the same result, unless a lock is left."""
    before = json.loads((run / "result.json").read_text(encoding="utf-8"))["parameters"]
    again = run_command(*(word for word in arguments if word != "--resume"), "--resume", longest_s=LONGEST_S)
    if again.code:
        return f"afterwards: {again.last_words}"
    after = json.loads((run / "result.json").read_text(encoding="utf-8"))["parameters"]
    return "" if after == before else "another result afterwards"


ATTACK = Attack(
    asks="10 starts at once on one RUN: one works, the others say so in one line, no lock stays behind",
    usual=3,
    trials=trials,
)
