"""Whether a command ended as it should: with its work done, or with one line that says what is wrong."""

import re
from collections.abc import Collection

from experiments.faults.commands import Ended

TRACEBACK = "Traceback (most recent call last)"
PREFIX = "jaxcalib: "
REFUSED = (2, 3, 4)  # exit codes for a wrong case, a simulator that failed, a disk or a cluster that gave out
LONGEST_LINE = 700
PYTHON_WARNING = re.compile(r"^\S+\.py:\d+: \w*Warning\b", re.MULTILINE)
FILE_OF_LINE = re.compile(r"jaxcalib: ([^:]+):")


def fault_of(
    code: int, err: str, *, may_say_more: bool = False, files: Collection[str] | None = None, is_late: bool = False
) -> str:
    """Return what is wrong with how a command ended; nothing where it worked, or was refused in one line.

    Args:
        code: exit code.
        err: what it said on standard error.
        may_say_more: whether there may be several such lines, one for each thing that is wrong.
        files: names one of which each line must begin with, where the case was refused.
        is_late: whether it had to be killed, because it took too long.
    """
    if TRACEBACK in err:
        return f"a traceback: {err.strip().splitlines()[-1]}"
    if is_late:
        return "it took too long and was killed"
    if warning := PYTHON_WARNING.search(err):
        return f"a warning of Python's: {err[warning.start() :].splitlines()[0]}"
    if code == 0:
        return ""
    if code not in REFUSED:
        return f"exit code {code}: {err.strip().splitlines()[-1] if err.strip() else 'not a word'}"
    lines = [line for line in err.splitlines() if line.strip()]
    own = [line for line in lines if line.startswith(PREFIX)]
    if not own:
        return f"refused without a line of its own: {lines[-1] if lines else 'not a word'}"
    if len(own) != len(lines):
        return f"says more than its own lines: {next(line for line in lines if line not in own)}"
    if len(own) > 1 and not may_say_more:
        return f"says {len(own)} lines, not one: {own[1]}"
    if longest := max((line for line in own if len(line) > LONGEST_LINE), key=len, default=""):
        return f"a line of {len(longest)} characters"
    if files is not None and code == REFUSED[0]:
        for line in own:
            match = FILE_OF_LINE.match(line)
            if match is None or not any(_is_name(match[1], file) for file in files):
                return f"names no file: {line}"
    return ""


def fault_of_ended(ended: Ended, *, may_say_more: bool = False, files: Collection[str] | None = None) -> str:
    """Return the same of a command that was a process of its own."""
    return fault_of(ended.code, ended.err, may_say_more=may_say_more, files=files, is_late=ended.is_late)


def _is_name(said: str, file: str) -> bool:
    """Whether a message means a file; long names are shortened there."""
    return said == file or (said.endswith("...") and file.startswith(said[:-3]))
