"""What a file may grow to in memory, so that a small compressed file cannot take all of it."""

import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from jaxcalib.errors import CaseError


@dataclass(frozen=True)
class SizeLimit:
    """Bounds of what is unpacked."""

    unpacked_bytes: int = 512 * 1024**2  # most bytes after unpacking, of a text and of the numbers that it says
    ratio: int = 200  # most bytes after unpacking per byte in the file
    # the ratio counts from this size on: short tables with constant columns pack very well
    ratio_from_bytes: int = 32 * 1024**2

    def check_bytes(self, file: Path, unpacked_bytes: int) -> None:
        """Refuse a file of which so much is unpacked.

        Raises:
            CaseError: it is too much.
        """
        if unpacked_bytes > self.unpacked_bytes:
            raise CaseError(file, "", f"expected at most {self.unpacked_bytes} bytes after unpacking.")

    def check_size(self, file: Path, unpacked_bytes: int) -> None:
        """Refuse a file of which so much is unpacked, also for how little of it is packed.

        Raises:
            CaseError: it is too much.
        """
        self.check_bytes(file, unpacked_bytes)
        if unpacked_bytes > max(self.ratio_from_bytes, self.ratio * file.stat().st_size):
            raise CaseError(file, "", f"expected to unpack to at most {self.ratio} times the file's size.")


OF_RECORDINGS = SizeLimit(unpacked_bytes=2 * 1024**3)  # of whole roads and hours, which a user brings in once


class BoundedStream(io.RawIOBase):
    """A stream that stops with an error once it has given too much; it closes the stream that it reads."""

    def __init__(self, file: Path, stream: io.BufferedIOBase, limit: SizeLimit) -> None:
        """Keep the stream; nothing is read yet."""
        self._file, self._stream, self._limit = file, stream, limit
        self._given_bytes = 0

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def readinto(self, buffer: bytearray | memoryview) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Fill a buffer as far as there is something, and return how far.

        Raises:
            CaseError: it is too much.
        """
        content = self._stream.read(len(buffer))
        buffer[: len(content)] = content
        self._given_bytes += len(content)
        self._limit.check_size(self._file, self._given_bytes)
        return len(content)

    def close(self) -> None:
        """Close both streams."""
        self._stream.close()
        super().close()


def pieces(file: Path, batches: Iterable[pa.RecordBatch], check: Callable[[Path, int], None]) -> list[pa.RecordBatch]:
    """Return the pieces of a file; the bytes that are unpacked are checked with each.

    After an error nothing of them is left: who keeps the error keeps its frames, and would keep half a gigabyte.

    Raises:
        CaseError: as `check` and the pieces' reader.
    """
    read: list[pa.RecordBatch] = []
    unpacked_bytes = 0
    try:
        for batch in batches:
            unpacked_bytes += batch.nbytes
            check(file, unpacked_bytes)
            read.append(batch)
    except CaseError:
        read.clear()
        raise
    return read
