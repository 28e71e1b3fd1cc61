"""Programs that were compiled once serve all tests, also those in processes of their own; the longest go first."""

import os
import shutil
import tempfile

import pytest

FOLDER = "JAX_COMPILATION_CACHE_DIR"
LONGEST_FIRST = (
    "test_whole_diagnosis.py",
    "test_corridor.py",
    "test_engines_and_kills.py",
    "test_cluster.py",
    "test_validate.py",
    "test_effects_in_the_simulator.py",
    "test_house.py",
    "test_other_classes.py",
    "test_optimiser_study.py",
)
IS_OURS = FOLDER not in os.environ  # workers inherit the folder of the process that started them

if IS_OURS:  # before JAX is imported, by another conftest perhaps
    os.environ[FOLDER] = tempfile.mkdtemp(prefix="jaxcalib-tests-")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"
    os.environ["JAX_COMPILATION_CACHE_MAX_SIZE"] = str(1 << 30)  # with a limit JAX locks the folder


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the folder."""
    if IS_OURS:
        shutil.rmtree(os.environ.pop(FOLDER), ignore_errors=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest, so that no worker is left with one of them while others have done all."""
    place = {name: number for number, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))
