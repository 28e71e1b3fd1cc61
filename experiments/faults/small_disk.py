"""Disks of their own: of a chosen size, full, or read-only; only root may mount them."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class NoDiskError(RuntimeError):
    """No disk can be mounted here."""


class SmallDisk:
    """A mounted disk."""

    def __init__(self, folder: Path) -> None:
        """Keep where it is mounted."""
        self.folder = folder

    def grow(self, size_bytes: int) -> None:
        """Make room, and let it be written to."""
        _mount("-o", f"remount,rw,size={size_bytes}", str(self.folder))

    def protect(self) -> None:
        """Let nobody write to it."""
        _mount("-o", "remount,ro", str(self.folder))

    @property
    def used_bytes(self) -> int:
        """What files take of it."""
        about = os.statvfs(self.folder)
        return (about.f_blocks - about.f_bfree) * about.f_frsize


@contextmanager
def small_disk(folder: Path, size_bytes: int) -> Iterator[SmallDisk]:
    """Mount a disk for a block.

    Raises:
        NoDiskError: it cannot be.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _mount("-t", "tmpfs", "-o", f"rw,size={size_bytes}", "tmpfs", str(folder))
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], capture_output=True, check=True)


def _mount(*words: str) -> None:
    if shutil.which("mount") is None:
        raise NoDiskError("no command mount")
    done = subprocess.run(["mount", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NoDiskError(done.stderr.strip())
