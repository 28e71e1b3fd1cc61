"""How a command ended is judged rightly: what works or is refused in a line passes, all else is a fault."""

import os
import signal
import time
from pathlib import Path

import pytest

from experiments.faults.commands import Started, peak_mb_of, processes_of_group, run_command
from experiments.faults.said import LONGEST_LINE, fault_of

LINE = "jaxcalib: case.toml: name: expected text."
SHORT_S = 30.0


@pytest.mark.parametrize(
    ("code", "err"), [(0, ""), (0, "SUMO said something"), (2, LINE), (4, "jaxcalib: /x: full.\n")]
)
def test_what_is_as_it_should_be(code: int, err: str):
    assert fault_of(code, err) == ""


@pytest.mark.parametrize(
    ("code", "err", "words"),
    [
        (0, "Traceback (most recent call last):\n  x\nKeyError: 5", "a traceback: KeyError: 5"),
        (2, "Traceback (most recent call last):\n  x\nKeyError: 5", "a traceback: KeyError: 5"),
        (1, "", "exit code 1: not a word"),
        (-signal.SIGSEGV, "", "exit code -11"),
        (2, "", "without a line"),
        (2, "something else", "without a line"),
        (2, f"{LINE}\n{LINE}", "says 2 lines"),
        (2, f"noise\n{LINE}", "more than its own lines: noise"),
        (2, f"jaxcalib: {'x' * LONGEST_LINE}", "a line of"),
        (0, "a/b.py:12: RuntimeWarning: divide\n  x = y / z", "a warning of Python's"),
    ],
)
def test_what_is_a_fault(code: int, err: str, words: str):
    assert words in fault_of(code, err)


def test_a_line_has_to_name_a_file_of_the_case():
    assert fault_of(2, LINE, files=["case.toml"]) == ""
    assert "names no file" in fault_of(2, LINE, files=["net.net.xml"])
    assert fault_of(2, f"{LINE}\n{LINE}", files=["case.toml"], may_say_more=True) == ""
    assert fault_of(2, "jaxcalib: averylongna...: x", files=["averylongname.xml"]) == ""


def test_a_command_s_words_code_and_memory(tmp_path: Path):
    """It keeps its memory until that was looked at: what is looked at now and then misses a last moment."""
    is_seen = tmp_path / "seen"
    code = (
        "import pathlib, sys, time; x = bytearray(150 << 20)\n"
        f"while not pathlib.Path({str(is_seen)!r}).exists(): time.sleep(0.01)\n"
        "print('out'); print('err', file=sys.stderr); sys.exit(3)"
    )
    started = Started([code], program=("-c",))
    while peak_mb_of(started.process) < 150.0:
        assert started.elapsed_s < SHORT_S
        time.sleep(0.01)
    assert started.poll() is None
    is_seen.touch()
    ended = started.wait(SHORT_S)
    assert (ended.code, ended.out, ended.err) == (3, "out\n", "err\n")
    assert 150.0 <= ended.peak_mb < 400.0
    assert ended.last_words == "err"


def test_a_command_that_comes_to_no_end_is_killed_with_what_it_has_started():
    sleep = "import time; time.sleep(60)"
    code = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {sleep!r}]); {sleep}"
    started = Started([code], program=("-c",))
    while len(processes_of_group(started.process)) < 2:
        assert started.elapsed_s < SHORT_S
        time.sleep(0.02)
    ended = started.wait(0.0)
    assert ended.is_late
    assert ended.code == -signal.SIGKILL
    assert "too long" in fault_of(ended.code, ended.err, is_late=ended.is_late)
    deadline_s = time.monotonic() + SHORT_S
    while processes_of_group(started.process):
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    assert os.getpgid(0) != started.process


def test_a_command_ends_with_a_study_that_is_stopped(tmp_path: Path):
    """By Ctrl-C; a command has a group of its own, which the terminal does not stop."""
    note = tmp_path / "process"
    code = (
        "from experiments.faults.commands import Started\n"
        "started = Started(['import time; time.sleep(60)'], program=('-c',))\n"
        f"open({str(note)!r}, 'w').write(str(started.process))\n"
        "raise KeyboardInterrupt"
    )
    study = run_command(code, program=("-c",), longest_s=SHORT_S)
    assert "KeyboardInterrupt" in study.err
    assert not processes_of_group(int(note.read_text()))
