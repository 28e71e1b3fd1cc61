"""Results go onto a disk that becomes full at some level, or that nobody may write to: one line, nothing damaged.

Where room is made then, the same command goes on and leaves what an undisturbed one leaves.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.commands import Ended, run_command
from experiments.faults.said import fault_of_ended
from experiments.faults.small_commands import COMMANDS, difference, reference_of
from experiments.faults.small_disk import NoDiskError, SmallDisk, small_disk

NUM_LEVELS = 10
ROOMY_BYTES = 1 << 30
LONGEST_S = 3600.0
DISK_FULL = ("No space left on device", "no room for SUMO's output")
DRAFT = ".draft"


@dataclass(frozen=True)
class Plan:
    """What is done in a trial."""

    command: str
    level: int = 0  # of the room that an undisturbed run takes, in tenths of it less half a tenth; 0 for none
    place: str = ""  # in which way the place is none; empty for a disk that becomes full

    @property
    def name(self) -> str:
        """The trial's name."""
        return f"{self.command}: {self.place or f'full at level {self.level} of {NUM_LEVELS}'}"


def read_only(disk: SmallDisk) -> Path:
    """Return a place on a disk that nobody may write to."""
    disk.protect()
    return disk.folder / "new" / "run"


def full(disk: SmallDisk) -> Path:
    """Return a place on a disk without any room."""
    with (disk.folder / "filler").open("wb") as file:
        try:
            while True:
                file.write(bytes(1 << 16))
                file.flush()
        except OSError:
            return disk.folder / "run"


def a_file(disk: SmallDisk) -> Path:
    """Return a place where a file is."""
    (disk.folder / "run").write_text("mine", encoding="utf-8")
    return disk.folder / "run"


def beneath_a_file(disk: SmallDisk) -> Path:
    """Return a place beneath a file."""
    return a_file(disk) / "run"


PLACES: Mapping[str, Callable[[SmallDisk], Path]] = {
    "on a read-only disk": read_only,
    "on a full disk": full,
    "where a file is": a_file,
    "beneath a file": beneath_a_file,
}
PLANS = [
    *(Plan("sweep in SUMO", level) for level in range(1, NUM_LEVELS + 1)),
    *(Plan(command, place=place) for command, place in product(("sweep", "calibrate", "diagnose"), PLACES)),
    *(Plan("calibrate", level) for level in range(1, NUM_LEVELS + 1)),
]


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials of these numbers."""
    for number in numbers:
        plan, began_s = PLANS[number], time.monotonic()
        folder = ground.fresh(f"{number:05d}")
        try:
            if plan.place:
                wrong, happened, peak_mb = _wrong_place(ground, plan, folder / "disk")
            else:
                wrong, happened, peak_mb = _becomes_full(ground, plan, folder / "disk")
        except NoDiskError as error:
            yield Trial(number, plan.name, "not run", str(error), 0.0)
            continue
        wall_s = time.monotonic() - began_s
        ending = "failed" if wrong else "passed"
        yield Trial(number, plan.name, ending, in_one_line(wrong or happened), wall_s, peak_mb)


def _wrong_place(ground: Ground, plan: Plan, folder: Path) -> tuple[str, str, float]:
    with small_disk(folder, 1 << 20) as disk:
        place = PLACES[plan.place](disk)
        before = _listing(folder)
        ended = run_command(*COMMANDS[plan.command].words(ground.case, place), longest_s=LONGEST_S)
        after = _listing(folder)
    wrong = fault_of_ended(ended)
    if ended.code == 0:
        wrong = "it says that it worked"
    elif not wrong and after != before:
        wrong = f"it has changed what was there: {sorted({*before, *after} - set(before)) or 'sizes'}"
    return wrong, ended.last_words, ended.peak_mb


def _becomes_full(ground: Ground, plan: Plan, folder: Path) -> tuple[str, str, float]:
    """Let a disk become full, look at what is there, make room, and go on."""
    reference, command = reference_of(ground, plan.command), COMMANDS[plan.command]
    taken_bytes = sum(_room_of(file) for file in reference.folder.rglob("*"))
    size_bytes = round(taken_bytes * (plan.level - 0.5) / NUM_LEVELS)
    with small_disk(folder, size_bytes) as disk:
        words = command.words(ground.case, folder / "run")
        ended = run_command(*words, longest_s=LONGEST_S)
        if wrong := fault_of_ended(ended):
            return wrong, "", ended.peak_mb
        if ended.code == 0:
            return _of_whole(command.result(folder / "run"), reference.result, ended, "there was room enough")
        said = ended.last_words
        if not any(words in said for words in DISK_FULL):
            return f"says nothing of the disk: {said}", "", ended.peak_mb
        if drafts := [file.name for file in folder.rglob("*") if file.name.endswith(DRAFT)]:
            return f"drafts are left on a full disk: {drafts}", "", ended.peak_mb
        disk.grow(ROOMY_BYTES)
        again = run_command(*words, longest_s=LONGEST_S)
        if again.code:
            return f"does not go on: {fault_of_ended(again) or again.last_words}", "", again.peak_mb
        happened = f"{size_bytes >> 10} KiB: {said}"
        return _of_whole(command.result(folder / "run"), reference.result, ended, happened)


def _of_whole(
    result: Mapping[str, str], wanted: Mapping[str, str], ended: Ended, happened: str
) -> tuple[str, str, float]:
    return difference(result, wanted), happened, ended.peak_mb


def _room_of(file: Path) -> int:
    """Bytes that a file takes of a disk with pages of 4 KiB."""
    return -(-file.lstat().st_size // 4096) * 4096 if file.is_file() else 0


def _listing(folder: Path) -> dict[str, int]:
    return {str(file.relative_to(folder)): file.lstat().st_size for file in folder.rglob("*")}


ATTACK = Attack(
    asks="OUT's disk becomes full at 10 levels, or cannot be written to: nothing damaged, one line, and it goes on",
    usual=len(PLANS),
    most=len(PLANS),
    trials=trials,
)
