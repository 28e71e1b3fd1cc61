"""What becomes of a command's errors: one line for the user, and an exit code."""

import sys
from collections.abc import Callable
from pathlib import Path

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.errors import CaseError, ResourceError, shorten
from sim_adapters.errors import TooLargeBatchError, WorkersEndedError

EXIT_CASE_WRONG = 2
EXIT_SIMULATOR_FAILED = 3
EXIT_RESOURCE = 4
EXIT_STOPPED = 130
LOG_FILE = "simulator.log"


def guarded(work: Callable[[], str], go_on: str, folder: Path | None = None, program: str = "jaxcalib") -> int:
    """Do the work of a command, print what it returns, and return the exit code.

    Args:
        work: returns what is to be printed at the end; nothing if empty.
        go_on: what a user who stopped it can do.
        folder: where a failed simulator's last words are kept; they are printed without it, or if it is not there.
        program: name in front of messages.
    """
    try:
        message = work()
    except CaseError as error:
        return _end(program, str(error), EXIT_CASE_WRONG)
    except (ResourceError, TooLargeBatchError) as error:
        return _end(program, str(error), EXIT_RESOURCE)
    except AllRunsFailedError as error:
        what = shorten(str(error), 250)
        if folder is None or not folder.is_dir():
            return _end(program, f"{what}. {shorten(error.log_tail, 250)}", EXIT_SIMULATOR_FAILED)
        (folder / LOG_FILE).write_text(error.log_tail + "\n", encoding="utf-8")
        return _end(program, f"{what}; see {folder / LOG_FILE}.", EXIT_SIMULATOR_FAILED)
    except WorkersEndedError as error:
        return _end(program, str(error), EXIT_SIMULATOR_FAILED)
    except KeyboardInterrupt:
        return _end(program, f"stopped; {go_on}", EXIT_STOPPED)
    if message:
        print(message)
    return 0


def _end(program: str, message: str, code: int) -> int:
    print(f"{program}: {message}", file=sys.stderr)
    return code
