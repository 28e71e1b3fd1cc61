import errno
from collections.abc import Callable
from pathlib import Path

import pytest

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.cli.guarded import LOG_FILE, MOST_FAULTS, guarded
from jaxcalib.errors import CaseError, ResourceError, raise_faults

GO_ON = "go on with --resume"
FAILED = AllRunsFailedError("no run succeeded", "Error: the last words.")


def raising(error: BaseException) -> Callable[[], str]:
    def work() -> str:
        raise error

    return work


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (CaseError("case.toml", "drive.role", "expected fit or held_out."), 2, "case.toml: drive.role: expected fit"),
        (FAILED, 3, "no run succeeded. Error: the last words."),
        (ResourceError("the disk is full."), 4, "the disk is full."),
        (KeyboardInterrupt(), 130, f"stopped; {GO_ON}"),
        (OSError(errno.ENOSPC, "No space left on device", "a/b"), 4, "a/b: No space left on device."),
        (OSError(errno.EROFS, "Read-only file system", "a/b"), 4, "a/b: Read-only file system."),
    ],
)
def test_each_kind_of_error_is_one_line_and_a_code(
    error: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]
):
    assert guarded(raising(error), GO_ON) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"jaxcalib: {line}")
    assert said.err.count("\n") == 1


def test_a_check_names_every_fault_of_a_case_and_other_commands_the_first(capsys: pytest.CaptureFixture[str]):
    faults = [CaseError("case.toml", f"key{number}", "expected another value.") for number in range(MOST_FAULTS + 3)]

    def work() -> str:
        raise_faults(faults)
        return ""

    assert guarded(work, GO_ON, names_all=True) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[:2] == [f"jaxcalib: case.toml: key{number}: expected another value." for number in range(2)]
    assert lines[MOST_FAULTS:] == ["jaxcalib: case.toml: 3 more faults."]
    assert guarded(work, GO_ON) == 2
    first = f"key0: expected another value. ({MOST_FAULTS + 2} more; jaxcalib check names all)"
    assert capsys.readouterr().err == f"jaxcalib: case.toml: {first}\n"


def test_the_simulator_s_last_words_are_kept_where_there_is_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert guarded(raising(FAILED), GO_ON, tmp_path) == 3
    assert (tmp_path / LOG_FILE).read_text() == "Error: the last words.\n"
    line = f"jaxcalib: no run succeeded. Error: the last words. See {tmp_path / LOG_FILE}.\n"
    assert capsys.readouterr().err == line


def test_the_simulator_s_last_words_are_said_where_they_cannot_be_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / LOG_FILE).mkdir()
    assert guarded(raising(FAILED), GO_ON, tmp_path) == 3
    assert capsys.readouterr().err == "jaxcalib: no run succeeded. Error: the last words.\n"


def test_what_other_errors_say_is_not_hidden():
    for error in (ZeroDivisionError, FileNotFoundError):
        with pytest.raises(error):
            guarded(raising(error()), GO_ON)


def test_a_command_says_what_its_work_says(capsys: pytest.CaptureFixture[str]):
    assert (guarded(lambda: "1.7 m", GO_ON), guarded(lambda: "", GO_ON)) == (0, 0)
    assert capsys.readouterr().out == "1.7 m\n"
