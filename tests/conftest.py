"""What all tests share: programs that were compiled once, and the cores, of which each worker has its own."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator

import pytest

WORKER, NUM_WORKERS = "PYTEST_XDIST_WORKER", "PYTEST_XDIST_WORKER_COUNT"
FOLDER = "JAX_COMPILATION_CACHE_DIR"
IS_OURS = FOLDER not in os.environ  # workers inherit the folder of the process that started them

if IS_OURS:  # before JAX is imported, by another conftest perhaps
    os.environ[FOLDER] = tempfile.mkdtemp(prefix="jaxcalib-tests-")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"
    os.environ["JAX_COMPILATION_CACHE_MAX_SIZE"] = str(1 << 30)  # with a limit JAX locks the folder

# Two workers whose surrogates each take all cores wait for one another: a whole diagnosis took 251 s alone and 605 s
# beside another worker. On cores of their own they do not. Processes that a test starts inherit them.
ALL_CORES = sorted(os.sched_getaffinity(0))
if WORKER in os.environ:
    own = ALL_CORES[int(os.environ[WORKER].removeprefix("gw")) :: int(os.environ[NUM_WORKERS])]
    os.sched_setaffinity(0, own or ALL_CORES)


@contextlib.contextmanager
def _on_all_cores() -> Iterator[None]:
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, ALL_CORES)
    try:
        yield
    finally:
        os.sched_setaffinity(0, own)


@pytest.fixture(scope="session")
def on_all_cores() -> Callable[[], contextlib.AbstractContextManager[None]]:
    """Return a context in which a process is started that is to use several devices and workers, as users' do."""
    return _on_all_cores


def pytest_unconfigure(config: pytest.Config) -> None:
    """Remove the folder."""
    if IS_OURS:
        shutil.rmtree(os.environ.pop(FOLDER), ignore_errors=True)
