"""Whether a disk takes what is to be written: asked before any work, and said in one line when it takes no more."""

import errno
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from jaxcalib.errors import CaseError, ResourceError
from sim_adapters.interface import RunOutcome, Status

DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
WRONG_PLACE = (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError)
DISK_FULL = ("disk full?", "No space left", "Disk quota exceeded")  # in a simulator's last words


def check_outside(out: Path, case: Path) -> None:
    """Check that results do not go into a case's folder: by its files a run tells whether it may be gone on with.

    Raises:
        CaseError: they do.
    """
    if out.resolve().is_relative_to(case.resolve()):
        raise CaseError(out, "", "expected a place outside the case's folder.")


def check_out(folder: Path) -> None:
    """Check before any work that its results can be written; nothing is left behind.

    Args:
        folder: where results go; it need not be there yet.

    Raises:
        CaseError: the folder is none, or must not be written to.
        ResourceError: the disk is full or broken.
    """
    with writing_to(folder):
        if folder.exists() and not folder.is_dir():
            raise CaseError(folder, "", "expected a folder, or a path where none is yet.")
        there = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(b"?")
    with writing_to(Path("TMPDIR")):
        tempfile.gettempdir()  # SUMO's files go there


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Turn what the disk says within the block into one line.

    Raises:
        ResourceError: the disk is full or broken.
        CaseError: the folder is not there, or must not be written to.
    """
    try:
        yield
    except OSError as error:
        if error.errno in DISK_ERRORS:
            raise full_disk(folder, error) from error
        if isinstance(error, WRONG_PLACE) or error.errno in (errno.EROFS, errno.ENAMETOOLONG):
            raise CaseError(folder, "", f"expected a folder that can be written to: {error.strerror}.") from error
        raise


def writing_to_scratch() -> AbstractContextManager[None]:
    """Do the same for the folder of SUMO's files."""
    return writing_to(Path(tempfile.gettempdir()))


def is_of_disk(error: OSError) -> bool:
    """Return whether it is the disk's fault, whatever was written: it is full, broken or read-only."""
    return error.errno in (*DISK_ERRORS, errno.EROFS)


def is_of_full_disk(log_tail: str) -> bool:
    """Return whether a simulator's last words say that a disk was full."""
    return any(words in log_tail for words in DISK_FULL)


def full_disk(folder: Path, error: OSError | str) -> ResourceError:
    """Return the error that says that a disk gave out."""
    reason = error.strerror if isinstance(error, OSError) else error
    return ResourceError(
        f"{folder}: {reason}. What was written before is whole and kept; make room and give the same command again, "
        "with --resume if that asks for it."
    )


def checked_disk(outcomes: list[RunOutcome]) -> list[RunOutcome]:
    """Return outcomes if none failed for want of disk space: that says nothing of the candidate.

    Raises:
        ResourceError: one did.
    """
    for outcome in outcomes:
        if outcome.status is Status.FAILED and is_of_full_disk(outcome.log_tail):
            raise full_disk(Path(tempfile.gettempdir()), "no room for SUMO's output")
    return outcomes
