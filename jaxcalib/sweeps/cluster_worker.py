"""What a worker of a cluster does: one block after another, with engines that stay from block to block."""

import atexit
import io
import multiprocessing
import os
import shutil
import tempfile
import threading
import zipfile
from pathlib import Path

from distributed import get_worker

from jaxcalib.case.case import read_case
from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import prepare_devices, sumo_engine
from jaxcalib.problem.problem import read_problem
from jaxcalib.runs.run_folder import identify
from jaxcalib.sweeps.local_engines import RoomySurrogate
from jaxcalib.sweeps.plan import Engine
from sim_adapters.interface import RunOutcome, RunRequest
from sim_adapters.sumo.simulator import SumoSimulator

_ENGINES: dict[tuple[str, str], RoomySurrogate | SumoSimulator] = {}
_ONE_AT_A_TIME = threading.Lock()  # an engine uses all cores that the worker has


def keep(content: bytes) -> bytes:
    """Return what is given: a task, so that the scheduler can make it again when a worker that holds it dies."""
    return content


def run_block(case: bytes, identity: dict[str, str], engine: Engine, requests: list[RunRequest]) -> list[RunOutcome]:
    """Make the runs of a block; the case comes as a zip archive of its folder.

    Raises:
        CaseError: this worker has another version of the program.
    """
    with _ONE_AT_A_TIME:
        key = (identity["case"], engine)
        if key not in _ENGINES:
            _ENGINES[key] = _prepared(case, identity, engine)
        return _ENGINES[key].run(requests)


def _prepared(case: bytes, identity: dict[str, str], engine: Engine) -> RoomySurrogate | SumoSimulator:
    folder = Path(tempfile.mkdtemp(prefix="jaxcalib-case-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    # not tar, whose extraction is safe from Python 3.11.4 on only
    with zipfile.ZipFile(io.BytesIO(case)) as archive:
        archive.extractall(folder)
    found = identify(read_case(folder), {})
    if found["program"] != identity["program"]:
        raise CaseError(
            "cluster", f"worker {os.uname().nodename}", "expected the version of program and libraries that the sweep "
            "was begun with; install the same there.",
        )  # fmt: skip
    num_cores = min(len(os.sched_getaffinity(0)), get_worker().state.nthreads)
    prepare_devices(num_cores)
    problem = read_problem(folder)
    if engine == "surrogate":
        return RoomySurrogate(problem)
    # Nannies start workers as daemons, which must not have children. SUMO's processes end with their parent by
    # themselves, which is what that rule is for.
    multiprocessing.current_process().daemon = False
    simulator = sumo_engine(problem, num_cores)
    atexit.register(simulator.close)
    return simulator
