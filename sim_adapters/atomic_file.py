"""Files that are there as a whole or not at all."""

import os
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path


def write_atomically(file: Path, write: Callable[..., object]) -> None:
    """Write a file beside its place and move it there, so that a kill at any moment leaves the whole of it or nothing.

    Several processes may write the same file: the last one wins. What a kill leaves has a name that begins with a dot.

    Args:
        file: where it goes.
        write: writes to an open binary file.
    """
    draft = file.with_name(f".{file.name}.{uuid.uuid4().hex[:12]}.draft")
    try:
        with draft.open("xb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(file)
    except BaseException:
        with suppress(OSError):
            draft.unlink(missing_ok=True)  # it takes room on a disk that has none
        raise
