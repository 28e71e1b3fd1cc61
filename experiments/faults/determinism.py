"""The same commands in other surroundings give the same results, but for times: one hash for all of them.

Surroundings are the number of workers, the seed of Python's hashes, a locale whose numbers have decimal commas, and a
sweep in four shards.
"""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from experiments.faults.altered import MODULE, Alterations
from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.commands import Ended, run_command
from experiments.faults.said import fault_of_ended
from experiments.faults.small_commands import COMMANDS, difference, digest_of, reference_of

LONGEST_S = 3600.0
GERMAN = "de_DE.UTF-8"
NUM_SHARDS = 4
COMMA = "import locale,sys;locale.setlocale(locale.LC_ALL,'');sys.exit(locale.localeconv()['decimal_point']!=',')"


@dataclass(frozen=True)
class Surroundings:
    """What is other than usual."""

    name: str
    workers: int = 1
    more: Mapping[str, str] = field(default_factory=dict)  # variables of the environment
    has_commas: bool = False  # whether numbers have decimal commas
    shards: int = 1  # parts in which a sweep is made


EVERYWHERE = (
    Surroundings("2 workers", workers=2),
    *(Surroundings(f"PYTHONHASHSEED {seed}", more={"PYTHONHASHSEED": str(seed)}) for seed in range(3)),
    Surroundings("decimal commas", has_commas=True),
)
SHARDS = (Surroundings("4 shards", shards=4), Surroundings("4 shards, 2 workers", workers=2, shards=4))
PLANS = [
    *((name, one) for name in ("sweep in SUMO", "sweep") for one in (*EVERYWHERE, *SHARDS)),
    *(("calibrate", one) for one in EVERYWHERE),
    *(("diagnose", one) for one in EVERYWHERE[:2]),
]


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials of these numbers."""
    for number in numbers:
        name, around = PLANS[number]
        title, began_s = f"{name}: {around.name}", time.monotonic()
        more = dict(around.more)
        if around.has_commas:
            german = german_environment(ground.folder / "locale")
            if german is None:
                yield Trial(number, title, "not run", f"no locale {GERMAN}, nor what makes it", 0.0)
                continue
            more |= german
        folder, reference = ground.fresh(f"{number:05d}"), reference_of(ground, name)
        altered = Alterations(cores=around.workers, uses_locale=around.has_commas)
        file = altered.write(folder / "alterations.json")
        words = [file, *COMMANDS[name].words(ground.case, folder / "run")]
        ended = [_run(each, more) for each in _parts(words, around.shards)]
        peak_mb = max(one.peak_mb for one in ended)
        wrong = next((fault_of_ended(one) or one.last_words for one in ended if one.code), "")
        happened = ""
        if not wrong:
            result = COMMANDS[name].result(folder / "run")
            wrong = difference(result, reference.result)
            happened = f"hash {digest_of(result)}"
        wall_s = time.monotonic() - began_s
        yield Trial(number, title, "failed" if wrong else "passed", in_one_line(wrong or happened), wall_s, peak_mb)


def _parts(words: list[str | Path], shards: int) -> list[list[str | Path]]:
    """Return the commands that make the same as one, in shards, with the one that joins them."""
    if shards == 1:
        return [words]
    return [
        *([*words, "--shard", f"{number}/{shards}"] for number in range(1, shards + 1)),
        [*words[:5], "--merge", "--quiet"],  # alterations, sweep, case, --out, table
    ]


def _run(words: Sequence[str | Path], more: Mapping[str, str]) -> Ended:
    return run_command(*words, program=MODULE, more=more, longest_s=LONGEST_S)


def german_environment(folder: Path) -> dict[str, str] | None:
    """Return the environment of a locale with decimal commas, which is made if need be; None where that cannot be."""
    wanted = {"LC_ALL": GERMAN}
    if _has_commas(wanted):
        return wanted
    if shutil.which("localedef") is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    command = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / GERMAN)]
    subprocess.run(command, capture_output=True, check=False)
    wanted |= {"LOCPATH": str(folder)}
    return wanted if _has_commas(wanted) else None


def _has_commas(more: Mapping[str, str]) -> bool:
    done = subprocess.run([sys.executable, "-c", COMMA], env=os.environ | dict(more), capture_output=True, check=False)
    return done.returncode == 0


ATTACK = Attack(
    asks="workers 1 and 2, PYTHONHASHSEED 0 to 2, decimal commas, shards 1 and 4: one hash of results without times",
    usual=len(PLANS),
    most=len(PLANS),
    trials=trials,
)
