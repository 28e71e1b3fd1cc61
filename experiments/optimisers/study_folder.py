"""The folder of a study: what was asked for, with which versions, and the tables; one study at a time."""

import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import pandas as pd
from filelock import FileLock, Timeout

from jaxcalib.errors import CaseError
from jaxcalib.runs.provenance import commit
from sim_adapters.atomic_file import write_atomically

FILE_NAME = "study.json"
MAY_GROW = ("optimisers", "seeds", "functions")  # searches do not depend on which others there are
LIBRARIES = ("jax", "numpy", "scipy", "scikit-learn", "optax", "pymoo", "cmaes", "optuna", "bayesian-optimization")


@contextmanager
def open_study(path: Path, configuration: dict[str, Any], resume: bool) -> Iterator[None]:
    """Hold a study's folder, begun or gone on with, for a block; the configuration is all that rows depend on.

    Raises:
        CaseError: the folder is in use, holds something else, or has been begun and `resume` is not set.
    """
    file = path / FILE_NAME
    if path.exists() and (not path.is_dir() or (not file.is_file() and any(path.iterdir()))):
        raise CaseError(path, "", "expected an empty folder, one that this study was begun in, or none yet.")
    if file.is_file():
        if not resume:
            raise CaseError(path, "", "a study was begun in this folder; add --resume to go on, or name another.")
        _check(file, configuration)
    path.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path.with_name(f".{path.name}.lock"))
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise CaseError(path, "", "expected a folder that nobody else uses; another study runs in it.") from None
    try:
        text = json.dumps({"configuration": configuration, **_provenance()}, indent=1) + "\n"
        write_atomically(file, lambda stream: stream.write(text.encode()))
        yield
    finally:
        lock.release()


def write_table(table: pd.DataFrame, path: Path, name: str) -> None:
    """Write a table as Parquet, for programs, and as CSV, for people."""
    write_atomically(path / f"{name}.parquet", lambda stream: table.to_parquet(stream, index=False))
    write_atomically(path / f"{name}.csv", lambda stream: table.to_csv(stream, index=False))


def _provenance() -> dict[str, Any]:
    versions = {"python": platform.python_version(), **{name: metadata.version(name) for name in LIBRARIES}}
    return {"versions": versions, "commit": commit()}


def _check(file: Path, configuration: dict[str, Any]) -> None:
    try:
        begun = json.loads(file.read_text(encoding="utf-8"))
        before, versions = dict(begun["configuration"]), begun["versions"]
    except (OSError, ValueError, KeyError, TypeError):
        raise CaseError(file, "", "expected what a study writes there; it cannot be read.") from None
    asked = json.loads(json.dumps(configuration))
    for key in asked:
        if key not in MAY_GROW and before.get(key) != asked[key]:
            raise CaseError(
                file, key, f"expected {before.get(key)}, with which this folder was begun; got {asked[key]}."
            )
    if versions != _provenance()["versions"]:
        raise CaseError(file, "versions", "expected those that this folder was begun with; name another to begin anew.")
