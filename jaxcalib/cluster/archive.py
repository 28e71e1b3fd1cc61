"""Files of a folder as one piece, for workers that may not see this machine's disks."""

import io
import zipfile
from pathlib import Path

FAST = 1  # zlib's level


def packed(folder: Path) -> bytes:
    """Return all files of a folder and of those in it."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=FAST, strict_timestamps=False) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, str(file.relative_to(folder)))
    return stream.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Write the files that were packed into a folder."""
    # not tar, whose extraction is safe from Python 3.11.4 on only
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        archive.extractall(folder)
