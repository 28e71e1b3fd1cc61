"""Asks a process of SUMO's own one question: libsumo holds one simulation per process, and may take it with it."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import msgspec

Said = TypeVar("Said")
ANSWER = "jaxcalib answer: "
MOST_LINES = 20
EXCEPTION = re.compile(r"TraCI(?:Exception|Error): (.+)")  # of libsumo, with SUMO's words
SAID_BEFORE = ("Process Error", "Could not parse commandline options.")  # the reason stands on standard error
HINTS = {
    r"ehicle type '.*' .*is not known": "Define that vType, or name another.",
    r"route '.*' .*is not known": "Define that route, or name another.",
    "Invalid repetition probability": 'It must lie between 0 and 1; period="exp(RATE)" takes any rate per second.',
    "Unknown car following model": "carFollowModel must be one of SUMO's models.",
    "On processing option": "Correct that option of the configuration, or leave it out.",
    r"Another .* with the id": "Give each an id of its own.",
    "network error": "Mend the network: netedit, or netconvert -s OLD.net.xml -o NEW.net.xml.",
}


def start_worker(
    module: str, question: dict[str, Any], longest_s: float, form: type[Said]
) -> Callable[[], tuple[Said | None, list[str]]]:
    """Start a worker's process.

    Args:
        module: the worker, which reads the question on standard input and prints `ANSWER` with JSON as its last line.
        question: what to ask.
        longest_s: when it is killed.
        form: type of the answer.

    Returns:
        What waits for the answer, None where the process ended without one of that form, and for all lines that it
        printed.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", module], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        encoding="utf-8", errors="replace", env=os.environ | {"LIBSUMO_AS_TRACI": "quiet"},
        start_new_session=True,  # a terminal's Ctrl-C is the command's; SUMO would be said to have failed
    )  # fmt: skip
    assert process.stdin is not None
    process.stdin.write(json.dumps(question))
    process.stdin.close()
    process.stdin = None

    def wait() -> tuple[Said | None, list[str]]:
        try:
            out, errors = process.communicate(timeout=longest_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return None, [f"it came to no end within {longest_s:g} s"]
        except BaseException:
            process.kill()
            process.communicate()
            raise
        lines = [line.strip() for line in (errors + out).splitlines()]
        answers = [line.removeprefix(ANSWER) for line in lines if line.startswith(ANSWER)]
        try:
            said = msgspec.convert(json.loads(answers[-1]), form) if answers else None
        except (ValueError, msgspec.ValidationError):  # its process was cut off, or something else writes there
            said, lines = None, ["its process gave no answer that can be read"]
        return said, lines or [f"its process ended with {process.returncode}"]

    return wait


def refusal(lines: Sequence[str]) -> str:
    """What SUMO said when it refused, and what can be done about it where its words do not say so."""
    thrown = [found[1] for line in lines if (found := EXCEPTION.search(line)) and found[1] not in SAID_BEFORE]
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
    words = " ".join(thrown[-1:] or dict.fromkeys(errors[:MOST_LINES])) or " ".join(lines[-3:])
    hint = next((hint for said, hint in HINTS.items() if re.search(said, words)), "")
    return f"{words.rstrip('. ')}. {hint}".rstrip()
