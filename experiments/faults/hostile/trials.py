"""Hostile cases are checked, and run in SUMO where they pass: nothing is written outside RUN, no socket is opened.

A page of theirs has no raw markup of a stranger's, a terminal gets no control characters, and nobody is told what
stands in files of others.
"""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from experiments.faults.attack import Attack, Ground, Trial, in_one_line
from experiments.faults.hostile.files import FILES
from experiments.faults.hostile.names import NAMES, RAW
from experiments.faults.hostile.place import Place
from experiments.faults.hostile.scenarios import SCENARIOS, Hostile
from experiments.faults.hostile.watched import Watched, watch
from experiments.faults.said import fault_of_ended

HOSTILE: Mapping[str, Hostile] = {**SCENARIOS, **NAMES, **FILES}
CALIBRATED = ("markup as a drive's id", "markup as an input's id", "markup as a flow's id")
LONGEST_CHECK_S, LONGEST_RUNS_S, LONGEST_CALIBRATION_S = 60.0, 300.0, 900.0
MOST_MEMORY_MB = 1500.0
PRINTED_CONTROLS = "\n\t\r"
FOREIGN = "root:x:0"  # how /etc/passwd begins


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the trials of these numbers."""
    names = list(HOSTILE)
    for number in numbers:
        yield try_case(ground, number, names[number], HOSTILE[names[number]])


def try_case(ground: Ground, number: int, name: str, make: Hostile) -> Trial:
    """Make a hostile case, give it to the commands, and say what they did."""
    place = Place(ground.fresh(f"{number:05d}"))
    shutil.copytree(ground.case, place.case)
    place.outside.mkdir()
    make(place)
    check = ("check", place.case, "--out", place.run / "check.html")
    commands: list[tuple[str, float, tuple[str | Path, ...]]] = [("check", LONGEST_CHECK_S, check)]
    sweep = ("sweep", place.case, "--out", place.run / "sweep.parquet", "--design", "lhs:2", "--seeds", "1")
    commands.append(("runs in SUMO", LONGEST_RUNS_S, (*sweep, "--engine", "sumo", "--quiet")))
    if name in CALIBRATED:
        calibrate = ("calibrate", place.case, "--out", place.run / "run", "--budget", "0.05", "--quiet")
        commands.append(("calibration", LONGEST_CALIBRATION_S, calibrate))
    wall_s, peak_mb, done = 0.0, 0.0, []
    wrong = ""
    for what, longest_s, arguments in commands:
        watched = watch(place, *arguments, longest_s=longest_s)
        wall_s, peak_mb = wall_s + watched.ended.wall_s, max(peak_mb, watched.ended.peak_mb)
        if wrong := complaint_of(place, watched, is_check=what == "check"):
            wrong = f"{what}: {wrong}"
            break
        done.append(f"{what}: {'done' if watched.ended.code == 0 else watched.ended.last_words}")
        if watched.ended.code:
            break
    if not wrong:
        shutil.rmtree(place.folder)  # those that failed are kept, to be looked at
    happened = in_one_line(wrong or "; ".join(done))
    return Trial(number, name, "failed" if wrong else "passed", happened, wall_s, peak_mb)


def complaint_of(place: Place, watched: Watched, *, is_check: bool) -> str:
    """Return what a command should not have done; nothing where all is well."""
    ended = watched.ended
    if ended.is_late:  # what a kill leaves is no fault
        return f"it took more than {ended.wall_s:.0f} s, and {ended.peak_mb:.0f} MB by then"
    if watched.written:
        return f"written outside RUN: {', '.join(watched.written[:5])}"
    if watched.sockets:
        return f"sockets: {', '.join(watched.sockets[:3])}"
    if wrong := fault_of_ended(ended, may_say_more=is_check):
        return wrong
    if FOREIGN in ended.out + ended.err:
        return "it says what stands in a file of others"
    if odd := {letter for letter in ended.out + ended.err if not letter.isprintable()} - set(PRINTED_CONTROLS):
        return f"control characters on the terminal: {sorted(odd)}"
    if is_check and ended.peak_mb > MOST_MEMORY_MB:
        return f"it took {ended.peak_mb:.0f} MB"
    return _raw_markup(place)


def _raw_markup(place: Place) -> str:
    for page in sorted(place.run.rglob("*")):
        if page.suffix not in (".html", ".svg"):
            continue
        text = page.read_text(encoding="utf-8")
        if found := next((raw for raw in RAW if raw in text), None):
            return f"{page.name} holds raw markup: {found}"
        if FOREIGN in text:
            return f"{page.name} says what stands in a file of others"
    return ""


ATTACK = Attack(
    asks=f"{len(HOSTILE)} hostile cases: nothing written outside RUN, no socket, no raw markup; check in 1.5 GB",
    usual=len(HOSTILE),
    most=len(HOSTILE),
    trials=trials,
)
