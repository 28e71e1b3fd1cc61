"""Long use: hundreds of runs of SUMO and a thousand batches of the surrogate, each in one process.

Memory after the first twenty grows by a twentieth at most, and nothing is compiled any more.
"""

import json
from collections.abc import Iterator, Sequence

from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.commands import run_command

PROGRAM = ("-m", "experiments.faults.soaking")
LONGEST_S = 7200.0
MOST_GROWTH = 0.05
PLANS = (("surrogate", 60), ("sumo", 60), ("surrogate", 1000), ("sumo", 500))  # the short ones to begin with


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials of these numbers."""
    for number in numbers:
        engine, rounds = PLANS[number]
        ended = run_command(engine, str(rounds), ground.case, program=PROGRAM, longest_s=LONGEST_S)
        title = f"{rounds} batches of the surrogate" if engine == "surrogate" else f"{rounds} runs of SUMO"
        if ended.code:
            wrong = happened = ended.last_words
        else:
            found = json.loads(ended.out.splitlines()[-1])
            wrong, happened = judged(found, rounds, compiles=engine == "surrogate")
        ending = "failed" if wrong else "passed"
        yield Trial(number, title, ending, in_one_line(wrong or happened), ended.wall_s, ended.peak_mb)


def judged(found: dict, rounds: int, compiles: bool) -> tuple[str, str]:
    """Return what is wrong with what a long use has taken, nothing where all is well; and what it was.

    Args:
        found: what `soaking` says.
        rounds: that were to be made.
        compiles: whether something has to be compiled to begin with; otherwise nobody would have listened.
    """
    first_mb, last_mb = found["settled_mb"], found["last_mb"]
    growth = last_mb / first_mb - 1.0
    words = f"{first_mb:.0f} MB, then {last_mb:.0f} MB ({growth:+.1%}); {found['compilations']} compilations"
    if found["rounds"] != rounds or found["failed"]:
        return f"{found['rounds']} rounds of {rounds}, {found['failed']} runs failed", words
    if compiles and not found["compilations_before"]:
        return "no compilation was heard of at all", words
    if growth > MOST_GROWTH:
        return f"memory grows: {words}", words
    return (f"compiles on: {words}" if found["compilations"] else ""), words


ATTACK = Attack(
    asks="500 runs of SUMO and 1,000 batches of the surrogate in one process: memory +5 %, nothing compiled any more",
    usual=len(PLANS),
    most=len(PLANS),
    trials=trials,
)
