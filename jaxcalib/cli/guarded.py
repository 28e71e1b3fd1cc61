"""What becomes of a command's errors: one line for the user, and an exit code."""

import shlex
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.errors import CaseError, ResourceError, shorten
from jaxcalib.runs.disk import full_disk, is_of_disk
from sim_adapters.errors import TooLargeBatchError, WorkersEndedError

EXIT_CASE_WRONG = 2
EXIT_SIMULATOR_FAILED = 3
EXIT_RESOURCE = 4
EXIT_STOPPED = 130
MOST_FAULTS = 20  # lines of one check
LOG_FILE = "simulator.log"


def to_go_on(*more: str) -> str:
    """Return how to go on with the command that stands on the command line, with options that it needs for that."""
    words = sys.argv[1:]
    return f"go on with: {shlex.join(['jaxcalib', *words, *(word for word in more if word not in words)])}"


def guarded(
    work: Callable[[], str],
    go_on: str,
    folder: Path | None = None,
    program: str = "jaxcalib",
    *,
    names_all: bool = False,
) -> int:
    """Do the work of a command, print what it returns, and return the exit code.

    Args:
        work: returns what is to be printed at the end; nothing if empty.
        go_on: what a user who stopped it can do.
        folder: where a failed simulator's last words are kept, too, if it is there.
        program: name in front of messages.
        names_all: whether each fault of a case is named, a line for each, and not the first alone.
    """
    try:
        message = work()
    except CaseError as error:
        return _end_case(program, error, names_all)
    except (ResourceError, TooLargeBatchError) as error:
        return _end(program, str(error), EXIT_RESOURCE)
    except AllRunsFailedError as error:
        what = shorten(str(error), 250)
        words = f" {shorten(error.log_tail, 250)}" if error.log_tail else ""
        return _end(program, f"{what}.{words}{_keep_log(error, folder)}", EXIT_SIMULATOR_FAILED)
    except WorkersEndedError as error:
        return _end(program, str(error), EXIT_SIMULATOR_FAILED)
    except KeyboardInterrupt:
        return _end(program, f"stopped; {go_on}", EXIT_STOPPED)
    except OSError as error:  # where nobody knew what was written; others are defects
        if not is_of_disk(error):
            raise
        place = Path(error.filename or folder or tempfile.gettempdir())
        return _end(program, str(full_disk(place, error)), EXIT_RESOURCE)
    if message:
        print(message)
    return 0


def _keep_log(error: AllRunsFailedError, folder: Path | None) -> str:
    """Keep a simulator's last words in a folder, and return what says so; nothing where they cannot be kept."""
    if folder is None or not folder.is_dir():
        return ""
    try:
        (folder / LOG_FILE).write_text(error.log_tail + "\n", encoding="utf-8")
    except OSError:
        return ""
    return f" See {folder / LOG_FILE}."


def _end_case(program: str, error: CaseError, names_all: bool) -> int:
    """Say what is wrong with a case, and return the exit code."""
    if not names_all:
        more = f" ({len(error.others)} more; jaxcalib check names all)" if error.others else ""
        return _end(program, f"{error}{more}", EXIT_CASE_WRONG)
    faults = (error, *error.others)
    for fault in faults[:MOST_FAULTS]:
        _end(program, str(fault), EXIT_CASE_WRONG)
    if (left := len(faults) - MOST_FAULTS) > 0:
        _end(program, f"{error.file}: {left} more faults.", EXIT_CASE_WRONG)
    return EXIT_CASE_WRONG


def _end(program: str, message: str, code: int) -> int:
    print(f"{program}: {message}", file=sys.stderr)
    return code
