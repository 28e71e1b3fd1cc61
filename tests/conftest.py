"""Programs that were compiled once serve all tests, also those in processes of their own."""

import os
import shutil
import tempfile

import pytest

FOLDER = "JAX_COMPILATION_CACHE_DIR"
IS_OURS = FOLDER not in os.environ  # workers inherit the folder of the process that started them

if IS_OURS:  # before JAX is imported, by another conftest perhaps
    os.environ[FOLDER] = tempfile.mkdtemp(prefix="jaxcalib-tests-")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"
    os.environ["JAX_COMPILATION_CACHE_MAX_SIZE"] = str(1 << 30)  # with a limit JAX locks the folder


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the folder."""
    if IS_OURS:
        shutil.rmtree(os.environ.pop(FOLDER), ignore_errors=True)
