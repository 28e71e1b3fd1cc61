"""What a worker of a cluster does for a sweep: one block after another, with engines that stay from block to block."""

import tempfile
import threading
from pathlib import Path

from jaxcalib.cluster.archive import unpack
from jaxcalib.cluster.at_worker import check_program, num_cores, scratch_folder, sumo_workers
from jaxcalib.problem.engines import prepare_devices, sumo_engine
from jaxcalib.problem.problem import read_problem
from jaxcalib.sweeps.local_engines import RoomySurrogate
from jaxcalib.sweeps.plan import Engine
from sim_adapters.interface import RunOutcome, RunRequest
from sim_adapters.sumo.simulator import SumoSimulator

_ENGINES: dict[tuple[str, str], RoomySurrogate | SumoSimulator] = {}
_ONE_AT_A_TIME = threading.Lock()  # an engine uses all cores that the worker has


def run_block(case: bytes, identity: dict[str, str], engine: Engine, requests: list[RunRequest]) -> list[RunOutcome]:
    """Make the runs of a block; the case comes as `archive.packed` packs its folder.

    Raises:
        CaseError: this worker has another version of the program.
    """
    check_program(identity["program"])
    with _ONE_AT_A_TIME:
        key = (identity["case"], engine)
        if key not in _ENGINES:
            _ENGINES[key] = _prepared(case, engine)
        return _ENGINES[key].run(requests)


def _prepared(case: bytes, engine: Engine) -> RoomySurrogate | SumoSimulator:
    folder = Path(tempfile.mkdtemp(prefix="case-", dir=scratch_folder()))
    unpack(case, folder)
    prepare_devices(num_cores())
    problem = read_problem(folder)
    return RoomySurrogate(problem) if engine == "surrogate" else sumo_engine(problem, workers=sumo_workers())
