"""A command's whole process group is killed at random moments; the same command goes on, as often as it is killed.

In the end the result is that of an undisturbed run, but for times, and no row of a table is lost or there twice.

A moment that comes after the command's end kills nobody. Then the command is begun anew, with moments from the time
that it has just taken: a machine that was busy when the undisturbed run was made is no excuse.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.commands import POLL_S, Started, processes_of_group
from experiments.faults.said import fault_of_ended
from experiments.faults.small_commands import COMMANDS, difference, reference_of

KILLED = ("sweep in SUMO", "calibrate", "sweep", "diagnose")  # in turn
EACH = 20  # trials of each
MOST_KILLS = 3
MOST_BEGINNINGS = 3  # in a trial
LONGEST_S = 3600.0
LATEST = 0.95  # of the time that an undisturbed run takes
END_S = 5.0  # within which all processes of a killed group are gone


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials of these numbers."""
    for number in numbers:
        name = KILLED[number % len(KILLED)]
        reference, command = reference_of(ground, name), COMMANDS[name]
        chance, began_s = ground.chance(number), time.monotonic()
        out = ground.folder / f"{number:05d}" / "run"
        words, killed = command.words(ground.case, out), Killed((), reference.wall_s, "")
        for _ in range(MOST_BEGINNINGS):
            ground.fresh(f"{number:05d}")
            killed = killed_at_random(words, chance, LATEST * killed.wall_s)
            if killed.moments_s or killed.wrong:
                break
        last = Started(words).wait(LONGEST_S)
        wrong = killed.wrong or fault_of_ended(last)
        if not wrong and last.code:
            wrong = f"does not go on: {last.last_words}"
        if not wrong:
            wrong = difference(command.result(out), reference.result)
        if not wrong and (doubled := command.num_doubled(out)):
            wrong = f"{doubled} rows are there twice"
        when = ", ".join(f"{moment_s:.1f}" for moment_s in killed.moments_s)
        title = f"{name}, killed at {when} s" if when else f"{name}, ended before it was to be killed"
        ending = "failed" if wrong else "passed" if when else "not run"
        wall_s = time.monotonic() - began_s
        yield Trial(number, title, ending, in_one_line(wrong or "result equal"), wall_s, last.peak_mb)


@dataclass(frozen=True)
class Killed:
    """What became of a command that was to be killed."""

    moments_s: tuple[float, ...]  # after each of its starts; none where it always ended before
    wall_s: float  # time of the last start
    wrong: str  # nothing where all is well


def killed_at_random(words: Sequence[str | Path], chance: np.random.Generator, latest_s: float) -> Killed:
    """Start a command one to three times, each time killing it at a random moment, until it ends before the moment.

    Args:
        words: of the command.
        chance: random numbers.
        latest_s: the latest moment.
    """
    moments_s: list[float] = []
    wrong, wall_s = "", 0.0
    for _ in range(int(chance.integers(1, MOST_KILLS + 1))):
        started = Started(words)
        moment_s = float(chance.uniform(0.0, latest_s))
        while (ended := started.poll()) is None and started.elapsed_s < moment_s:
            time.sleep(POLL_S)
        wall_s = started.elapsed_s
        if ended is not None:
            wrong = wrong or fault_of_ended(ended)
            break
        started.kill()
        moments_s.append(moment_s)
        wrong = wrong or _left_alive(started.process)
    return Killed(tuple(moments_s), wall_s, wrong)


def _left_alive(group: int) -> str:
    """Return what is wrong where processes outlive a kill of their group."""
    until_s = time.monotonic() + END_S
    while alive := processes_of_group(group):
        if time.monotonic() > until_s:
            return f"{len(alive)} processes are left"
        time.sleep(POLL_S)
    return ""


ATTACK = Attack(
    asks="kill -9 at random moments of calibrate, diagnose, sweep, the same command again: result equal, no row lost",
    usual=EACH * len(KILLED),
    trials=trials,
)
