"""An attack on the program: what is asked of it, its trials, and the ground on which they are made."""

import shutil
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from filelock import FileLock

Ending = Literal["passed", "failed", "not run"]
LONGEST_SHOWN = 400
LONGEST_CASE_S = 300.0
NUM_DRIVES = 4  # of the case that is attacked: few, for commands are run by the hundred


@dataclass(frozen=True)
class Trial:
    """One trial: what was done, and how the program bore it."""

    number: int  # of the trial within its attack; with the seed, it decides what is done
    name: str  # what was done
    ending: Ending  # "not run" where this machine does not let it be made: it is not counted
    happened: str  # in one line
    wall_s: float  # time of what was tried
    peak_mb: float | None = None  # most memory of the process; None where nobody looked


@dataclass(frozen=True)
class Ground:
    """Where an attack is made."""

    folder: Path  # of the attack's own files
    case_folder: Path  # where the case that is attacked lies, or will
    seed: int  # of all random numbers

    @property
    def case(self) -> Path:
        """A small, sound case, made at the first call; whoever alters it copies it first."""
        with FileLock(self.case_folder.with_name(f".{self.case_folder.name}.lock")):
            if not self.case_folder.is_dir():
                draft = self.case_folder.with_name(f".{self.case_folder.name}.draft")
                command = [sys.executable, "-m", "experiments.small_case", str(draft), str(NUM_DRIVES)]
                subprocess.run(command, env=environment(), check=True, timeout=LONGEST_CASE_S)
                draft.rename(self.case_folder)
        return self.case_folder

    def chance(self, number: int) -> np.random.Generator:
        """Return the random numbers of a trial; they depend on the seed, the attack and its number alone."""
        return np.random.default_rng([self.seed, zlib.crc32(self.folder.name.encode()), number])

    def fresh(self, name: str) -> Path:
        """Return an empty folder; what lay there goes."""
        folder = self.folder / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        return folder


@dataclass(frozen=True)
class Attack:
    """An attack and what is asked of the program under it."""

    asks: str  # what is asked
    usual: int  # trials, unless told otherwise
    # makes the trials of these numbers, one after the other
    trials: Callable[[Ground, Sequence[int]], Iterator[Trial]]
    most: int | None = None  # trials that there are; None where any number can be drawn

    def numbers(self, number: int | None) -> range:
        """Return the numbers of the trials to be made, where so many are wanted."""
        wanted = self.usual if number is None else number
        return range(wanted if self.most is None else min(wanted, self.most))


def environment(**more: str) -> dict[str, str]:
    """Return the environment of a process that is to import these packages, wherever it is started."""
    import os

    root = str(Path(__file__).parents[2])
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH", "")])])
    return os.environ | {"PYTHONPATH": path} | more


def in_one_line(text: str) -> str:
    """Return text as the table of trials shows it."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_SHOWN else f"{line[: LONGEST_SHOWN - 3]}..."
