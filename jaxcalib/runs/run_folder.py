"""RUN: the folder that keeps a journal and takes results, and goes on with nothing but what it was begun with."""

import hashlib
import json
import platform
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

import sim_adapters
import surrogate
from jaxcalib.case.case import Case
from jaxcalib.case.case_file import CHECK_PAGE
from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.runs.disk import writing_to
from jaxcalib.runs.journal import Journal
from sim_adapters.atomic_file import write_atomically
from sim_adapters.scenario.configuration import read_configuration

IDENTITY_FILE = "run.json"
LIBRARIES = ("jax", "jaxlib", "numpy", "scipy", "scikit-learn", "libsumo")
PARTS = ("case", "options", "program")
SAYS = {
    "case": "expected the case that this was begun with; it is another one, or has changed",
    "options": "expected the options that this was begun with",
    "program": "expected the version of program and libraries that this was begun with",
}


class RunFolder:
    """An open RUN folder; nobody else can open it meanwhile."""

    def __init__(self, path: Path, lock: FileLock, journal: Journal) -> None:
        """Keep what `open_run_folder` has prepared."""
        self.path = path
        self.journal = journal
        self._lock = lock

    def __enter__(self) -> "RunFolder":
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Let others open the folder."""
        self._lock.release()

    def write_text(self, name: str, text: str) -> None:
        """Write a file of the folder as a whole.

        Raises:
            CaseError, ResourceError: the disk does not take it.
        """
        with writing_to(self.path):
            write_atomically(self.path / name, lambda file: file.write(text.encode()))


def open_run_folder(path: Path, identity: dict[str, str], resume: bool) -> RunFolder:
    """Open a RUN folder with what is there, or begin one; the identity is what its runs depend on.

    Raises:
        CaseError: the folder belongs to something else, is in use, cannot be written to, or has been begun and
            `resume` is not set.
        ResourceError: the disk is full.
    """
    if path.exists() and not path.is_dir():
        raise CaseError(path, "", "expected a folder, or a path where none is yet.")
    file = path / IDENTITY_FILE
    if path.is_dir() and not file.is_file() and any(entry.name != ".lock" for entry in path.iterdir()):
        raise CaseError(path, "", "expected an empty folder, or one that a run was begun in.")
    if file.is_file():
        _check_begun(file, identity, resume)
    with writing_to(path):
        path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(path / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise CaseError(path, "", "expected a folder that nobody else uses; another run goes on in it.") from None
        if not file.is_file():
            text = json.dumps(identity, indent=1) + "\n"
            write_atomically(file, lambda stream: stream.write(text.encode()))
        return RunFolder(path, lock, Journal(path / "journal"))


def identify(case: Case, options: dict[str, Any], more_packages: Sequence[Path] = ()) -> dict[str, str]:
    """Return digests of all that runs depend on: the case's files, the options, the program with its libraries.

    More packages are folders of code above this one that runs depend on, too.
    """
    files = hashlib.sha256()
    _add_files(files, case.folder, files_within(case))
    for file in files_elsewhere(case):
        files.update(hashlib.sha256(file.read_bytes()).digest())
    return {
        "case": f"{case.name} {files.hexdigest()}",
        "options": json.dumps(options, sort_keys=True),
        "program": identify_program(more_packages),
    }


def identify_program(more_packages: Sequence[Path] = ()) -> str:
    """Return the digest of the program with its libraries; see `identify`."""
    program = hashlib.sha256()
    below = (Path(p) for package in (sim_adapters, surrogate) for p in package.__path__)
    own = (Path(__file__).parents[1], *below)
    for package in (*own, *more_packages):
        _add_files(program, package, package.rglob("*.py"))
    versions = [f"{name} {metadata.version(name)}" for name in LIBRARIES]
    program.update("\n".join([*versions, platform.python_version(), platform.machine()]).encode())
    return program.hexdigest()


def files_within(case: Case) -> Iterator[Path]:
    """Files in a case's folder, but for the page that a check draws there: it must not keep a run from going on."""
    return (file for file in case.folder.rglob("*") if file.is_file() and file != case.folder / CHECK_PAGE)


def files_elsewhere(case: Case) -> tuple[Path, ...]:
    """Files of a case that lie outside of its folder: logs, the scenario's configuration, and what that names."""
    named = [file for drive in case.drives for file in (drive.subject_file, drive.objects_file)]
    if case.scenario is not None:
        configuration = read_configuration(case.scenario.config_file)
        named += [configuration.file, configuration.net_file]
        named += [*configuration.additional_files, *configuration.route_files]
    return tuple(sorted({file.resolve() for file in named if not file.resolve().is_relative_to(case.folder)}))


def _add_files(digest: Any, folder: Path, files: Iterable[Path]) -> None:
    for file in sorted(files):
        if file.is_file() and "__pycache__" not in file.parts:
            digest.update(f"{file.relative_to(folder)}\0".encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())


def check_identity(file: Path, found: dict[str, Any], identity: dict[str, str]) -> None:
    """Check that what was begun is what is asked for now; the file says in messages where it stands.

    Raises:
        CaseError: they differ, or there is none in `found`.
    """
    try:
        parts = {part: str(found[part]) for part in PARTS}
    except (KeyError, TypeError):
        raise CaseError(file, "", "expected what a run writes there; it cannot be read.") from None
    if parts["case"] != identity["case"]:
        raise CaseError(file, "case", f"{SAYS['case']} ({quote(parts['case'].rpartition(' ')[0])}).")
    for part in ("options", "program"):
        if parts[part] != identity[part]:
            detail = f" ({_differing(parts[part], identity[part])})" if part == "options" else ""
            raise CaseError(file, part, f"{SAYS[part]}{detail}; name another one to begin anew.")


def _differing(begun: str, now: str) -> str:
    """Return which options differ, and how."""
    try:
        one, other = json.loads(begun), json.loads(now)
        names = [name for name in sorted({*one, *other}) if one.get(name) != other.get(name)]
    except (ValueError, TypeError, AttributeError):
        return shorten(begun)
    return ", ".join(f"{name} {quote(one.get(name))}, not {quote(other.get(name))}" for name in names)


def read_identity(file: Path) -> dict[str, Any]:
    """Return what a file says of the runs that it belongs to.

    Raises:
        CaseError: it cannot be read.
    """
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise CaseError(file, "", "expected what a run writes there; it cannot be read.") from None
    return found if isinstance(found, dict) else {}


def _check_begun(file: Path, identity: dict[str, str], resume: bool) -> None:
    found = read_identity(file)
    if found.get("case") == identity["case"] and not resume:
        place = f"{file.parent.name}/{IDENTITY_FILE}"
        raise CaseError(place, "", "a run was begun in this folder; add --resume to go on, or name another.")
    check_identity(file, found, identity)
