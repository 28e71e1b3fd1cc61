"""What a command takes, how to go on in its own words, and Ctrl-C, which ends it wherever it comes."""

import os
import signal
import subprocess
import sys
import time

import pytest

from jaxcalib.cli.app import app
from jaxcalib.cli.guarded import to_go_on
from tests.places import ROOT

# A callback that swallows what is raised in it, as the garbage collector's do: the interrupt comes while it is at work.
SWALLOWED = """
import signal
import time
from jaxcalib.cli.interrupts import end_wherever_interrupted

class Callback:
    def __del__(self):
        print("ready", flush=True)
        time.sleep(30.0)

signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever runs in the background is made to ignore it
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
end_wherever_interrupted()
try:
    Callback()
    time.sleep(30.0)
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_interrupt_that_a_callback_swallows_is_given_again():
    process = subprocess.Popen(
        [sys.executable, "-c", SWALLOWED], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=20.0)
    assert (process.returncode, out, errors) == (0, "stopped\n", "")


def test_the_whole_command_is_what_goes_on(monkeypatch: pytest.MonkeyPatch):
    words = ["validate", "a case", "run", "--out", "v", "--drives", "fit"]
    monkeypatch.setattr(sys, "argv", ["/bin/jaxcalib", *words])
    expected = "go on with: jaxcalib validate 'a case' run --out v --drives fit"
    assert to_go_on() == expected
    assert to_go_on("--resume") == f"{expected} --resume"
    monkeypatch.setattr(sys, "argv", ["/bin/jaxcalib", *words, "--resume"])
    assert to_go_on("--resume") == f"{expected} --resume"


@pytest.mark.parametrize("number", ["1.5", "1e3", "x"])
def test_what_is_no_whole_number_is_refused(number: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        app(["calibrate", "case", "--out", "run", "--seed", number])
    assert ended.value.code != 0
    assert f"expected a whole number, got {number}" in capsys.readouterr().err
