"""The files of a sweep while it goes on: one Parquet file per block, whole or not at all.

A block's file is named after its number, so that a block that is made twice replaces itself: no row is ever there
twice, however often runs are stopped, and whoever makes them.
"""

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from jaxcalib.errors import CaseError
from jaxcalib.runs.disk import writing_to
from jaxcalib.runs.parts import Parts
from jaxcalib.runs.run_folder import check_identity, read_identity
from jaxcalib.sweeps.plan import Shard
from sim_adapters.atomic_file import write_atomically

DESCRIPTION_FILE = "_sweep.json"  # readers of Parquet skip names that begin so, and with a dot
METADATA_KEY = b"jaxcalib_sweep"
BEGIN_S = 60.0  # the longest that others need to begin a sweep


class SweepStore:
    """Blocks of a sweep in the folder beside its table."""

    def __init__(self, table: Path) -> None:
        """Keep the place of the table; nothing is read or written before it is asked for."""
        self.table = table
        self.folder = table.with_name(f"{table.name}.parts")
        self._parts = Parts(self.folder)
        self._locks = ExitStack()

    def __enter__(self) -> "SweepStore":
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Let others go on."""
        self._locks.close()

    @property
    def is_begun(self) -> bool:
        """Whether there is anything of a sweep yet."""
        return self.table.exists() or (self.folder / DESCRIPTION_FILE).exists()

    @property
    def is_complete(self) -> bool:
        """Whether the table is there with all its rows."""
        return self.table.is_file()

    def begin(self, description: dict[str, Any], identity: dict[str, str]) -> dict[str, Any]:
        """Begin a sweep, or find it begun already.

        Args:
            description: what is written down of it.
            identity: what its rows depend on; part of the description.

        Returns:
            The description as it was written down first.

        Raises:
            CaseError: there is something else, or another sweep.
        """
        if self.table.exists():
            found = self.description()
            check_identity(self.table, found["identity"], identity)
            return found
        with writing_to(self.folder):
            if self.folder.exists() and not self.folder.is_dir():
                raise CaseError(self.folder, "", "expected a folder, or nothing yet.")
            self.folder.mkdir(parents=True, exist_ok=True)
            file = self.folder / DESCRIPTION_FILE
            with FileLock(self.folder / ".begin.lock", timeout=BEGIN_S):
                if not file.exists():
                    if any(not entry.name.startswith(".") for entry in self.folder.iterdir()):
                        raise CaseError(self.folder, "", "expected an empty folder, or one that a sweep was begun in.")
                    text = json.dumps(description, indent=1) + "\n"
                    write_atomically(file, lambda stream: stream.write(text.encode()))
                found = self.description()
        check_identity(file, found["identity"], identity)
        return found

    def description(self) -> dict[str, Any]:
        """Return what was written down of the sweep.

        Raises:
            CaseError: there is none, or it cannot be read.
        """
        if self.table.exists():
            return _description_of_table(self.table)
        found = read_identity(self.folder / DESCRIPTION_FILE)
        if not isinstance(found.get("identity"), dict):
            raise CaseError(
                self.folder / DESCRIPTION_FILE, "", "expected what a sweep writes there; it cannot be read."
            )
        return found

    def claim(self, shard: Shard) -> None:
        """Make sure that nobody else makes these blocks meanwhile; ends with the process at the latest.

        Raises:
            CaseError: somebody does.
        """
        for other in self.folder.glob(".shard-*.lock"):
            of = other.stem.removeprefix(".shard-")
            if of.partition("-of-")[2] != str(shard.count) and _is_held(other):
                raise CaseError(
                    "command line", "--shard", f"expected the same number of shards as jobs that run now: shard "
                    f"{of.replace('-of-', '/')} of {self.table.name} is at work.",
                )  # fmt: skip
        lock = FileLock(self.folder / f".shard-{shard.number}-of-{shard.count}.lock")
        try:
            self._locks.enter_context(lock.acquire(timeout=0))
        except Timeout:
            raise CaseError(
                self.table, "", f"expected that nobody else makes shard {shard}; another job does."
            ) from None

    def claim_all(self) -> None:
        """Make sure that no job is at work.

        Raises:
            CaseError: one is.
        """
        for file in self.folder.glob(".shard-*.lock"):
            try:
                self._locks.enter_context(FileLock(file).acquire(timeout=0))
            except Timeout:
                of = file.stem.removeprefix(".shard-").replace("-of-", "/")
                raise CaseError(self.table, "", f"expected that all jobs are done; shard {of} is at work.") from None

    def shard_counts(self) -> set[int]:
        """Return the numbers of shards that jobs were told of so far."""
        return {int(file.stem.rpartition("-")[2]) for file in self.folder.glob(".shard-*-of-*.lock")}

    def file_of(self, block: int) -> Path:
        """Return the file of a block."""
        return self._parts.file_of(_name_of(block))

    def finished(self, num_rows: Callable[[int], int], num_blocks: int) -> set[int]:
        """Return the blocks that are there as a whole; files that are damaged are removed."""
        there = set(self._parts.names("block-*.parquet"))

        def is_whole(block: int) -> bool:
            def load(file: Path) -> bool:
                if pq.read_metadata(file).num_rows != num_rows(block):
                    raise ValueError("another number of rows")
                return True

            name = _name_of(block)
            return name in there and self._parts.read(name, load) is not None

        return {block for block in range(num_blocks) if is_whole(block)}

    def write(self, block: int, rows: pa.Table) -> None:
        """Keep a block.

        Raises:
            ResourceError: the disk is full.
        """
        self._parts.write(_name_of(block), lambda stream: pq.write_table(rows, stream, compression="zstd"))


def _name_of(block: int) -> str:
    return f"block-{block:06d}.parquet"


def _is_held(file: Path) -> bool:
    lock = FileLock(file)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return True
    lock.release()
    return False


def _description_of_table(table: Path) -> dict[str, Any]:
    try:
        found = json.loads((pq.read_schema(table).metadata or {})[METADATA_KEY])
        assert isinstance(found["identity"], dict)
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError, AssertionError):
        raise CaseError(table, "", "expected the table of a sweep, or a name that is not taken yet.") from None
    return found
