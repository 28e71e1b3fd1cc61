"""Runs a command and watches what it touches: files outside of RUN, and internet sockets, of Python's and SUMO's."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.faults.commands import POLL_S, PROGRAM, Ended, Started, processes_of_group
from experiments.faults.hostile.place import Place

SOCKETS_SEEN = Path(__file__).with_name("sockets_seen")
TABLES = ("tcp", "tcp6", "udp", "udp6", "raw")
INODE = 9  # column of those tables
Listing = Mapping[str, tuple[int, int]]


@dataclass(frozen=True)
class Watched:
    """What a command did."""

    ended: Ended
    written: list[str]  # files outside of RUN that are new, gone or others
    sockets: list[str]  # internet sockets


def watch(place: Place, *arguments: str | Path, longest_s: float, program: Sequence[str] = PROGRAM) -> Watched:
    """Run a command in a folder of its own, and watch it.

    Python's sockets are noted by a hook within its processes, SUMO's are looked for in the system's tables meanwhile.
    """
    scratch, notes = place.folder / "tmp", place.run / "sockets.txt"
    for folder in (scratch, place.folder / "cwd", place.run):
        folder.mkdir(exist_ok=True)
    notes.unlink(missing_ok=True)
    before = _listing(place)
    seen: set[str] = set()
    path = os.pathsep.join([str(SOCKETS_SEEN), str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")])
    more = {
        "FAULTS_SOCKETS": str(notes), "PYTHONPATH": path.rstrip(os.pathsep), "TMPDIR": str(scratch),
        "MPLCONFIGDIR": str(place.run / "matplotlib"), "PYTHONDONTWRITEBYTECODE": "1",
    }  # fmt: skip
    started = Started(arguments, program=program, cwd=place.folder / "cwd", more=more)
    while started.poll() is None and started.elapsed_s < longest_s:
        seen |= _sockets_of(processes_of_group(started.process))
        time.sleep(POLL_S)
    ended = started.wait(longest_s)
    if notes.exists():
        seen |= set(notes.read_text(encoding="utf-8").splitlines())
    after = _listing(place)
    written = sorted(name for name in {*before, *after} if before.get(name) != after.get(name))
    return Watched(ended, written, sorted(seen))


def _listing(place: Place) -> Listing:
    """Size and time of change of all that lies around RUN, and of what lies beside the trial's folder."""
    found: dict[str, tuple[int, int]] = {}
    for folder, inner, names in os.walk(place.folder):
        if Path(folder) == place.folder:
            inner.remove(place.run.name)
        for name in (*inner, *names):
            file = Path(folder) / name
            about = file.lstat()
            size = about.st_size if file.is_file() else 0
            found[str(file.relative_to(place.folder))] = (size, 0 if file.is_dir() else about.st_mtime_ns)
    for parent in (place.folder.parent, place.folder.parents[1]):
        found |= {f"{parent.name}/{entry.name}": (0, 0) for entry in parent.iterdir()}
    return found


def _sockets_of(processes: list[int]) -> set[str]:
    inodes = set()
    for process in processes:
        try:
            links = [os.readlink(file) for file in Path(f"/proc/{process}/fd").iterdir()]
        except OSError:
            continue  # it has ended
        inodes |= {link[8:-1] for link in links if link.startswith("socket:[")}
    found = set()
    for table in TABLES if inodes else ():
        for line in Path(f"/proc/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            words = line.split()
            if words[INODE] in inodes:
                found.add(f"{table} {words[1]}")
    return found
