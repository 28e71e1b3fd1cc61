"""What a disk says that takes no more, as one line for users."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxcalib.errors import CaseError, ResourceError

DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


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
