"""What a disk says that takes no more, as one line for users."""

import errno
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxcalib.errors import CaseError, ResourceError
from sim_adapters.interface import RunOutcome, Status

DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
DISK_FULL = ("disk full?", "No space left", "Disk quota exceeded")  # in a simulator's last words


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Turn what the disk says within the block into one line.

    Args:
        folder: where is written to.

    Raises:
        ResourceError: the disk is full or broken.
        CaseError: the folder is not there, or must not be written to.
    """
    try:
        yield
    except OSError as error:
        if error.errno in DISK_ERRORS:
            raise full_disk(folder, error) from error
        if isinstance(error, PermissionError | FileNotFoundError | NotADirectoryError) or error.errno == errno.EROFS:
            raise CaseError(folder, "", f"expected a folder that can be written to: {error.strerror}.") from error
        raise


def full_disk(folder: Path, error: OSError | str) -> ResourceError:
    """Return the error that says that a disk gave out."""
    reason = error.strerror if isinstance(error, OSError) else error
    return ResourceError(
        f"{folder}: {reason}. What was written before is whole and kept; make room and give the same command again."
    )


def checked_disk(outcomes: list[RunOutcome]) -> list[RunOutcome]:
    """Return outcomes if none failed for want of disk space: that says nothing of the candidate.

    Raises:
        ResourceError: one did.
    """
    for outcome in outcomes:
        if outcome.status is Status.FAILED and any(words in outcome.log_tail for words in DISK_FULL):
            raise full_disk(Path(tempfile.gettempdir()), "no room for SUMO's output")
    return outcomes
