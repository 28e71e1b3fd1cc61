"""What a worker of a cluster does for a sweep: one block after another, of a case that stays from block to block."""

import tempfile
import threading
from pathlib import Path

from jaxcalib.cluster.archive import unpack
from jaxcalib.cluster.at_worker import check_program
from jaxcalib.cluster.sumo_pools import num_cores, scratch_folder, sumo_workers_for
from jaxcalib.problem.engines import prepare_devices, sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.sweeps.local_engines import RoomySurrogate
from jaxcalib.sweeps.plan import Engine
from sim_adapters.interface import RunOutcome, RunRequest

_PROBLEMS: dict[str, CalibrationProblem] = {}  # by the case's identity
_SURROGATES: dict[str, RoomySurrogate] = {}
_ONE_AT_A_TIME = threading.Lock()  # an engine uses all cores that the worker has


def run_block(case: bytes, identity: dict[str, str], engine: Engine, requests: list[RunRequest]) -> list[RunOutcome]:
    """Make the runs of a block; the case comes as `archive.packed` packs its folder.

    Raises:
        CaseError: this worker has another version of the program.
    """
    check_program(identity["program"])
    with _ONE_AT_A_TIME:
        name = identity["case"]
        if name not in _PROBLEMS:
            _PROBLEMS[name] = _read(case)
        if engine == "surrogate":
            if name not in _SURROGATES:
                _SURROGATES[name] = RoomySurrogate(_PROBLEMS[name])
            return _SURROGATES[name].run(requests)
        with sumo_workers_for(name) as workers:
            return sumo_engine(_PROBLEMS[name], workers=workers).run(requests)


def _read(case: bytes) -> CalibrationProblem:
    folder = Path(tempfile.mkdtemp(prefix="case-", dir=scratch_folder()))
    unpack(case, folder)
    prepare_devices(num_cores())
    return read_problem(folder)
