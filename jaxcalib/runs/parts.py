"""Finished parts of a longer work, each a file of its own, so that the work goes on where it was stopped.

A part is there as a whole or not at all. One that cannot be read all the same is taken away and made again. What
parts belong to is checked by whoever opens the folder around them (`jaxcalib.runs.run_folder.check_identity`).
"""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pyarrow as pa

from jaxcalib.runs.disk import writing_to
from sim_adapters.atomic_file import write_atomically

DAMAGE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, pa.ArrowException)

Part = TypeVar("Part")


class Parts:
    """A folder of parts."""

    def __init__(self, folder: Path) -> None:
        """Keep the place."""
        self.folder = folder

    @classmethod
    def begin(cls, folder: Path) -> "Parts":
        """Return the parts of a folder, which is made if it is not there.

        Raises:
            ResourceError: the disk is full.
            CaseError: the folder cannot be made.
        """
        with writing_to(folder):
            folder.mkdir(parents=True, exist_ok=True)
        return cls(folder)

    def names(self, pattern: str) -> list[str]:
        """Return the names of the parts that match a pattern, in their order."""
        return sorted(file.name for file in self.folder.glob(pattern) if not file.name.startswith("."))

    def file_of(self, name: str) -> Path:
        """Return where a part lies."""
        return self.folder / name

    def read(self, name: str, load: Callable[[Path], Part]) -> Part | None:
        """Return a part; None where there is none, or only a damaged one, which is removed.

        Whatever `load` raises of `DAMAGE` says that the part is damaged.
        """
        file = self.file_of(name)
        if not file.is_file():
            return None
        try:
            return load(file)
        except DAMAGE:
            file.unlink(missing_ok=True)
            return None

    def write(self, name: str, save: Callable[..., object]) -> None:
        """Keep a part.

        Raises:
            ResourceError: the disk is full.
            CaseError: the folder is gone, or must not be written to.
        """
        with writing_to(self.folder):
            write_atomically(self.file_of(name), save)
