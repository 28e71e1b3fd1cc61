"""Every command looks at the place for its results before any work, and says in one line what is wrong with it."""

import errno
import importlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from jaxcalib.cli import app as cli
from jaxcalib.cli.guarded import EXIT_CASE_WRONG, EXIT_RESOURCE
from jaxcalib.errors import CaseError, ResourceError
from jaxcalib.runs.run_folder import open_run_folder
from tests.places import CORRIDOR

IDENTITY = {"case": "corridor 1", "options": "{}", "program": "2"}
Command = Callable[[Path], int]

COMMANDS: dict[str, Command] = {
    "calibrate": lambda out: cli.calibrate(CORRIDOR, out=out),
    "diagnose": lambda out: cli.diagnose(CORRIDOR, out=out),
    "validate": lambda out: cli.validate(CORRIDOR, CORRIDOR.parent, out=out),
    "sweep": lambda out: cli.sweep(CORRIDOR, out=out / "sweep.parquet"),
    "fit-following": lambda out: cli.fit_following(Path("pairs.csv"), out=out),
}
READERS = {
    "jaxcalib.calibration.pipeline": "read_problem",
    "jaxcalib.diagnosis.run": "read_problem",
    "jaxcalib.validation.validate": "read_problem",
    "jaxcalib.sweeps.preparation": "read_problem",
    "jaxcalib.pair_fitting.recorded_pairs": "read_pairs",
}


class WorkHasBegunError(Exception):
    """Something was read that a command works on."""


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(*arguments: object, **options: object) -> None:
        raise WorkHasBegunError

    for module, name in READERS.items():
        monkeypatch.setattr(importlib.import_module(module), name, read)


@pytest.fixture
def mount(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Return what mounts a small disk of its own; tests run as root, whom no permission stops."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def mounted(options: str) -> Path:
        command = ["mount", "-t", "tmpfs", "-o", f"size=64k,{options}", "tmpfs", str(folder)]
        if shutil.which("mount") is None or subprocess.run(command, capture_output=True, check=False).returncode:
            pytest.skip("no disk can be mounted here")
        return folder

    yield mounted
    if os.path.ismount(folder):
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(disk: Path) -> Path:
    """Leave no room on a disk; return the file that takes it."""
    filler = disk / "filler"
    with pytest.raises(OSError, match="No space left"):
        filler.write_bytes(bytes(1 << 17))
    return filler


def line_of(capsys: pytest.CaptureFixture[str]) -> str:
    """Return what was said, which must be one line on standard error."""
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("jaxcalib: ")
    assert said.err.count("\n") == 1
    return said.err


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("place", ["beneath a file", "where nothing can be made", "too long a name"])
def test_a_place_that_cannot_be(
    command: str, place: str, no_work: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "file").write_text("mine")
    place_of = {
        "beneath a file": tmp_path / "file" / "run",
        "where nothing can be made": Path("/proc/jaxcalib/run"),
        "too long a name": tmp_path / ("x" * 300) / "run",
    }
    assert COMMANDS[command](place_of[place]) == EXIT_CASE_WRONG
    assert "expected a folder that can be written to" in line_of(capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("command", [name for name in COMMANDS if name != "sweep"])
def test_a_file_in_place_of_the_folder(command: str, no_work: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "run").write_text("mine")
    assert COMMANDS[command](tmp_path / "run") == EXIT_CASE_WRONG
    assert "run: expected a folder, or a path where none is yet." in line_of(capsys)
    assert (tmp_path / "run").read_text() == "mine"


@pytest.mark.parametrize("command", COMMANDS)
def test_a_read_only_disk(
    command: str, no_work: None, mount: Callable[[str], Path], capsys: pytest.CaptureFixture[str]
):
    assert COMMANDS[command](mount("ro") / "new" / "run") == EXIT_CASE_WRONG
    assert "expected a folder that can be written to: Read-only file system." in line_of(capsys)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk(command: str, no_work: None, mount: Callable[[str], Path], capsys: pytest.CaptureFixture[str]):
    disk = mount("rw")
    fill(disk)
    assert COMMANDS[command](disk / "new" / "run") == EXIT_RESOURCE
    assert "No space left on device." in line_of(capsys)
    assert [path.name for path in disk.iterdir()] == ["filler"]


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_left_where_the_work_ends_at_once(command: str, no_work: None, tmp_path: Path):
    with pytest.raises(WorkHasBegunError):
        COMMANDS[command](tmp_path / "new" / "run")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", COMMANDS)
def test_no_folder_for_temporary_files(
    command: str, no_work: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: ["/proc/jaxcalib"])
    assert COMMANDS[command](tmp_path / "run") == EXIT_CASE_WRONG
    assert "TMPDIR: expected a folder that can be written to" in line_of(capsys)


@pytest.mark.parametrize("beneath", [".", "run", "a/b/run", "../link/run"])
@pytest.mark.parametrize("command", ["calibrate", "diagnose", "validate", "sweep"])
def test_results_never_go_into_the_case(
    command: str, beneath: str, no_work: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """What lies in a case tells whether a run may be gone on with; a run within would change it."""
    case = tmp_path / "case"
    case.mkdir()
    (tmp_path / "link").symlink_to(case)
    out = case / beneath
    code = {
        "calibrate": lambda: cli.calibrate(case, out=out),
        "diagnose": lambda: cli.diagnose(case, out=out),
        "validate": lambda: cli.validate(case, tmp_path, out=out),
        "sweep": lambda: cli.sweep(case, out=out / "sweep.parquet"),
    }[command]()
    assert code == EXIT_CASE_WRONG
    assert "expected a place outside the case's folder." in line_of(capsys)
    assert not list(case.iterdir())


def test_a_run_within_the_case_is_not_validated_there(
    no_work: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.validate(tmp_path, tmp_path / "run") == EXIT_CASE_WRONG
    assert "outside the case's folder" in line_of(capsys)


def test_a_folder_that_a_full_disk_has_kept_from_being_begun_can_be_begun(mount: Callable[[str], Path]):
    disk = mount("rw")
    filler = fill(disk)
    with pytest.raises(ResourceError, match="No space left on device"):
        open_run_folder(disk / "run", IDENTITY, False)
    filler.unlink()
    with open_run_folder(disk / "run", IDENTITY, False) as folder:
        folder.write_text("result.json", "{}")
        fill(disk)
        with pytest.raises(ResourceError, match="No space left on device"):
            folder.write_text("result.json", "1" * 8192)
        assert (folder.path / "result.json").read_text() == "{}"
        assert not list(folder.path.glob("*.draft"))


def test_a_disk_that_became_read_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*arguments: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with open_run_folder(tmp_path / "run", IDENTITY, False) as folder:
        monkeypatch.setattr(os, "fsync", refuse)
        with pytest.raises(CaseError, match="Read-only file system"):
            folder.write_text("result.json", "{}")
    assert not list((tmp_path / "run").glob(".*.draft"))


def test_pairs_whose_fit_finds_the_disk_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def write(folder: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    module = importlib.import_module("jaxcalib.pair_fitting.recorded_pairs")
    monkeypatch.setattr(module, "read_pairs", lambda *arguments: ([], []))
    module = importlib.import_module("jaxcalib.pair_fitting.study")
    monkeypatch.setattr(module, "study_pairs", lambda *arguments: SimpleNamespace(write=write))
    assert cli.fit_following(Path("pairs.csv"), out=tmp_path) == EXIT_RESOURCE
    assert "No space left on device." in line_of(capsys)


def missing(folder: Path) -> Path:
    return folder / "nowhere.csv"


def a_folder(folder: Path) -> Path:
    (folder / "pairs.csv").mkdir()
    return folder / "pairs.csv"


def noise(folder: Path) -> Path:
    (folder / "pairs.csv").write_bytes(bytes(range(256)) * 8)
    return folder / "pairs.csv"


def noise_as_parquet(folder: Path) -> Path:
    return noise(folder).rename(folder / "pairs.parquet")


def noise_as_gzip(folder: Path) -> Path:
    return noise(folder).rename(folder / "pairs.csv.gz")


def beneath_a_file(folder: Path) -> Path:
    return noise(folder) / "pairs.csv"


UNREADABLE = [missing, a_folder, noise, noise_as_parquet, noise_as_gzip, beneath_a_file]


@pytest.mark.parametrize("make", UNREADABLE)
def test_pairs_that_cannot_be_read(make: Callable[[Path], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.fit_following(make(tmp_path), out=tmp_path / "out") == EXIT_CASE_WRONG
    assert "pairs" in line_of(capsys) or make is missing
    assert not (tmp_path / "out").exists()
