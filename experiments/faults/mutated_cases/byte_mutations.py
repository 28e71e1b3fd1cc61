"""Mutations of any file, as bytes: cut off, emptied, flipped, in another encoding, or no file at all."""

import gzip
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

ByteMutation = Callable[[Path, np.random.Generator], str]
FEW_BYTES = 20


def cut_off(file: Path, chance: np.random.Generator) -> str:
    """End it early."""
    content = file.read_bytes()
    size = int(chance.integers(1, max(2, len(content))))
    file.write_bytes(content[:size])
    return f"cut off after {size} of {len(content)} bytes"


def emptied(file: Path, chance: np.random.Generator) -> str:
    """Leave nothing in it."""
    file.write_bytes(b"")
    return "emptied"


def flipped(file: Path, chance: np.random.Generator) -> str:
    """Change a few bytes anywhere."""
    content = bytearray(file.read_bytes())
    places = chance.integers(0, len(content), FEW_BYTES) if content else []
    for place in places:
        content[place] = int(chance.integers(256))
    file.write_bytes(bytes(content))
    return f"{len(places)} bytes are others"


def zeros_put_in(file: Path, chance: np.random.Generator) -> str:
    """Put zero bytes somewhere, as a crash of a file system does."""
    content = file.read_bytes()
    place = int(chance.integers(len(content) + 1))
    file.write_bytes(content[:place] + bytes(512) + content[place:])
    return f"512 zero bytes at {place}"


def other_encoding(file: Path, chance: np.random.Generator) -> str:
    """Write it in another encoding than UTF-8."""
    encoding = str(chance.choice(["utf-16", "utf-32", "utf-8-sig", "cp1252", "shift_jis"]))
    text = file.read_bytes().decode("utf-8", errors="replace")
    place = int(chance.integers(len(text) + 1)) if encoding in ("cp1252", "shift_jis") else 0
    word = {"cp1252": "Straßenlänge", "shift_jis": "道路"}.get(encoding, "")
    file.write_bytes((text[:place] + word + text[place:]).encode(encoding, errors="replace"))
    return f"in {encoding}" + (f" with '{word}' at {place}" if word else "")


def twice(file: Path, chance: np.random.Generator) -> str:
    """Write its content twice, one behind the other."""
    file.write_bytes(file.read_bytes() * 2)
    return "its content twice"


def packed(file: Path, chance: np.random.Generator) -> str:
    """Pack it without saying so in its name."""
    file.write_bytes(gzip.compress(file.read_bytes()))
    return "packed without .gz"


def noise(file: Path, chance: np.random.Generator) -> str:
    """Put noise in its place."""
    file.write_bytes(chance.bytes(2000))
    return "noise"


def missing(file: Path, chance: np.random.Generator) -> str:
    """Take it away."""
    file.unlink()
    return "missing"


def a_folder(file: Path, chance: np.random.Generator) -> str:
    """Put a folder in its place."""
    file.unlink()
    file.mkdir()
    return "a folder"


def a_loop(file: Path, chance: np.random.Generator) -> str:
    """Put a link to itself in its place."""
    file.unlink()
    file.symlink_to(file.name)
    return "a link to itself"


def another_file(file: Path, chance: np.random.Generator) -> str:
    """Put another file of the case in its place."""
    others = sorted(one for one in file.parents[1].rglob("*") if one.is_file() and one != file)
    other = others[int(chance.integers(len(others)))]
    shutil.copyfile(other, file)
    return f"it is {other.name}"


BYTE_MUTATIONS: Mapping[str, ByteMutation] = {
    function.__name__: function
    for function in (
        cut_off, emptied, flipped, zeros_put_in, other_encoding, twice, packed, noise, missing, a_folder, a_loop,
        another_file,
    )
}  # fmt: skip
