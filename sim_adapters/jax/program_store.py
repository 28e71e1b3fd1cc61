"""Keeps compiled programs of the surrogate in files, so that the next process neither traces nor compiles them.

JAX's own persistent cache saves compiling, but needs the program's text, and tracing alone takes seconds here. So a
program is found by what it is made from: the pickled records that are traced, the sources of the packages that trace
them, versions, JAX's settings, devices and the processor. Whatever differs there gives another name; a record that
cannot be pickled, or is of a class from elsewhere, is not kept at all.

What is loaded is the machine code that was compiled, so runs give the same bits from either.
"""

import hashlib
import importlib.metadata
import io
import os
import pickle
import sys
import threading
import zlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import jax
from jax.experimental import serialize_executable

from sim_adapters.atomic_file import write_atomically
from sim_adapters.jax.processor import processor

SUFFIX = ".program"
MOST_PROGRAMS = 32  # of some 2 MB each; the least recently used go
SOURCES = ("surrogate", "sim_adapters", "jaxcalib")
LIBRARIES = ("jax", "jaxlib", "equinox", "numpy")
CACHE_HIT = "/jax/compilation_cache/cache_hits"
_hits = threading.local()


class ProgramStore:
    """Programs in a folder; several processes may use it at once."""

    def __init__(self, folder: Path) -> None:
        """Keep the folder, which is made when there is something to keep.

        Args:
            folder: only its owner may be able to write to it, for what it holds is executed.
        """
        self._folder = folder

    def key(self, ingredients: Sequence[Any]) -> str | None:
        """Return the name of a program; None if it cannot be told from all others.

        Args:
            ingredients: everything of this process that the program depends on: records, arrays, numbers.
        """
        found = io.BytesIO()
        pickler = _Pickler(found)
        try:
            pickler.dump(tuple(ingredients))
        except (pickle.PicklingError, TypeError, AttributeError, ValueError):
            return None
        packages = {module.partition(".")[0] for module in pickler.modules}
        if not packages <= {*SOURCES, *LIBRARIES, "builtins", "copyreg", "collections", "functools"}:
            return None
        parts = (found.getvalue(), _sources().encode(), repr(_surroundings()).encode())
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()

    def load(self, key: str, arguments: Any, result: Any) -> jax.stages.Compiled | None:
        """Return a program; None if it is not there or cannot be used.

        Args:
            key: its name.
            arguments: the tuple of its arguments, or of anything of the same structure.
            result: anything of the structure of its result.
        """
        file = self._file(key)
        try:
            payload = zlib.decompress(file.read_bytes())
            os.utime(file)
        except (OSError, zlib.error):
            return None
        try:
            return serialize_executable.deserialize_and_load(
                payload, jax.tree.structure((arguments, {})), jax.tree.structure(result)
            )
        except Exception:  # whatever JAX says of a program that is not for this machine: it is compiled again
            file.unlink(missing_ok=True)
            return None

    def save(self, key: str, program: jax.stages.Compiled) -> None:
        """Keep a program that was compiled, not loaded; does nothing where that is impossible."""
        try:
            payload, _, _ = serialize_executable.serialize(program)
        except (ValueError, NotImplementedError, jax.errors.JaxRuntimeError):
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_atomically(self._file(key), lambda stream: stream.write(zlib.compress(payload, 1)))
            self._forget()
        except OSError:  # full or read-only: the next process compiles
            return

    def _file(self, key: str) -> Path:
        return self._folder / f"{key}{SUFFIX}"

    def _forget(self) -> None:
        """Delete the programs that were not used for longest."""
        used: list[tuple[float, Path]] = []
        for file in self._folder.glob(f"*{SUFFIX}"):
            try:
                used.append((file.stat().st_mtime, file))
            except OSError:  # another process has deleted it
                continue
        for _, file in sorted(used, reverse=True)[MOST_PROGRAMS:]:
            file.unlink(missing_ok=True)


def program_store() -> ProgramStore | None:
    """Return the store beside JAX's persistent cache; None where that is off or not a folder of this machine."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if not folder or "://" in folder or not jax.config.jax_enable_compilation_cache:  # pyright: ignore[reportAttributeAccessIssue]
        return None
    return ProgramStore(Path(folder))


def compile_afresh(lowered: jax.stages.Lowered, options: dict[str, Any]) -> tuple[jax.stages.Compiled, bool]:
    """Return a compiled program, and whether it was compiled and not taken from JAX's cache.

    What JAX took from its cache cannot be written to a file again: its functions would be missing.
    """
    _listen()
    _hits.number = 0
    program = lowered.compile(options)
    return program, _hits.number == 0


@cache
def _listen() -> None:
    def on_event(event: str, **_: Any) -> None:
        if event == CACHE_HIT:  # told in the thread that compiles
            _hits.number = getattr(_hits, "number", 0) + 1

    jax.monitoring.register_event_listener(on_event)


class _Pickler(pickle.Pickler):
    """Notes the modules of all classes and functions."""

    def __init__(self, file: io.BytesIO) -> None:
        """Begin with none."""
        super().__init__(file, protocol=5)
        self.modules: set[str] = set()

    def reducer_override(self, obj: Any) -> Any:
        """Take part in pickling without changing it."""
        if isinstance(obj, type | FunctionType):
            self.modules.add(obj.__module__)
        return NotImplemented


@cache
def _sources() -> str:
    """Return a digest of the sources that programs are traced from."""
    digest = hashlib.sha256()
    for name in SOURCES:
        package: ModuleType | None = sys.modules.get(name)
        if package is None or package.__file__ is None:
            continue
        folder = Path(package.__file__).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(f"{name}/{file.relative_to(folder)}".encode())
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _surroundings() -> tuple[Any, ...]:
    """Return what else the code of a program depends on."""
    settings = {name: value for name, value in jax.config.values.items() if "cache" not in name}
    devices = [(device.platform, device.device_kind, device.id) for device in jax.devices()]
    versions = [importlib.metadata.version(name) for name in LIBRARIES]
    platform_version = jax.devices()[0].client.platform_version
    flags = {name: value for name, value in os.environ.items() if name.startswith(("XLA_", "LIBTPU_"))}
    return (sorted(settings.items()), devices, versions, platform_version, sorted(flags.items()),
            sys.version, processor())  # fmt: skip
