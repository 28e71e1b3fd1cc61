"""What all tests share: programs compiled once, cores of one's own, a small case, and the corridor in several forms.

Fixtures import what they need when they are asked for it: JAX reads its environment when it is imported first.
"""

import contextlib
import gc
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from filelock import FileLock
from threadpoolctl import threadpool_limits

from jaxcalib.cli.compilation_cache import keep_compiled_programs
from tests.copies import copy_corridor
from tests.places import CORRIDOR, ROOT

if TYPE_CHECKING:
    from jaxcalib.problem.problem import CalibrationProblem
    from sim_adapters.interface import ParameterLayout
    from sim_adapters.jax.simulator import JaxSimulator
    from sim_adapters.scenario.scenario import Scenario
    from sim_adapters.world.world_builder import WorldTemplate
    from surrogate.effects.settings import Effects
    from surrogate.loop.world import World
    from surrogate.road.traffic_state import TrafficState

WORKER, NUM_WORKERS = "PYTEST_XDIST_WORKER", "PYTEST_XDIST_WORKER_COUNT"
PROGRAMS = "JAXCALIB_CACHE"
FOLDER = "JAXCALIB_TESTS_FOLDER"
GIVEN = "JAXCALIB_TESTS_GIVEN_XLA_FLAGS"  # workers inherit what the process was given that started them
IS_OURS = FOLDER not in os.environ  # workers inherit the folder of the process that started them

# Programs are kept from one call of the tests to the next, too, as the command line keeps them: found by what they are
# made from, so that what has changed is traced and compiled anew.
os.environ.setdefault(PROGRAMS, str(ROOT / ".pytest_cache" / "programs"))
# Most programs of tests are run a few times: so they are made in a third of the time, and run for twice as long. What
# they compute is the same but for rounding. Processes that a test starts inherit that. Where bits count, tests take
# programs as users do: `as_users_do`, `programs_as_users_do`. Flags that are given come last, and count.
QUICKLY = ("--xla_backend_optimization_level=0", "--xla_cpu_use_fusion_emitters=false")
GIVEN_FLAGS = os.environ.setdefault(GIVEN, os.environ.get("XLA_FLAGS", ""))
os.environ["XLA_FLAGS"] = " ".join([*QUICKLY, GIVEN_FLAGS]).strip()
# As many devices as commands on a worker's core say that there are: a program's name depends on it, and tests and most
# processes that they start have some programs in common.
os.environ.setdefault("JAX_NUM_CPU_DEVICES", "1")
keep_compiled_programs()
if IS_OURS:
    os.environ[FOLDER] = tempfile.mkdtemp(prefix="jaxcalib-tests-")

# Two workers whose surrogates each take all cores wait for one another: a whole diagnosis took 251 s alone and 605 s
# beside another worker. On cores of their own they do not. Processes that a test starts inherit them.
ALL_CORES = sorted(os.sched_getaffinity(0))
if WORKER in os.environ:
    own = ALL_CORES[int(os.environ[WORKER].removeprefix("gw")) :: int(os.environ[NUM_WORKERS])]
    os.sched_setaffinity(0, own or ALL_CORES)

# Nor do they where each has a pool of threads for matrices: those of two workers on two cores spin while they wait for
# one another, and matrices here are small. A test of inference took 42 s of processor time instead of 10.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for what is loaded later, and processes that tests start
threadpool_limits(1, "blas")

gc.disable()  # until tests are collected, see `pytest_collection_finish`


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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the checks of the house; then files that run simulators, so that short ones fill the end.

    What a commit can do without is long as well.
    """
    for item in items:
        if item.get_closest_marker("nightly"):
            item.add_marker(pytest.mark.long)
    house = {item.path for item in items if item.path.name == "test_house.py"}
    long = {item.path for item in items if item.get_closest_marker("long") and not item.get_closest_marker("nightly")}
    items.sort(key=lambda item: (item.path not in house, item.path not in long))


def pytest_collection_finish() -> None:
    """Never look again for cycles in modules and items, which stay until the end: that took a twelfth of all time."""
    gc.freeze()
    gc.enable()


def pytest_report_collectionfinish(items: list[pytest.Item]) -> list[str]:
    """List the tests that only a nightly run makes, with the reasons, where they were asked for."""
    marks = ((item.nodeid, item.get_closest_marker("nightly")) for item in items)
    return [f"nightly: {name}: {mark.args[0]}" for name, mark in marks if mark is not None]


@pytest.fixture(scope="session")
def small_case() -> Path:
    """A case of one kilometre, see `experiments.small_case`; workers share it, so whoever alters it copies it first."""
    folder = Path(os.environ[FOLDER])
    with FileLock(folder / "small.lock"):
        if not (folder / "small").is_dir():
            command = [sys.executable, "-m", "experiments.small_case", str(folder / "being made" / "small")]
            subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True)
            (folder / "being made" / "small").rename(folder / "small")
    return folder / "small"


@pytest.fixture(scope="session")
def small_problem(small_case: Path) -> "CalibrationProblem":
    from jaxcalib.problem.problem import read_problem

    return read_problem(small_case)


@pytest.fixture(scope="session")
def small_surrogate(small_problem: "CalibrationProblem") -> "JaxSimulator":
    """The small case's surrogate: compiled once for all workers and for what tests start with a single device."""
    from jaxcalib.problem.engines import surrogate_engine

    engine = surrogate_engine(small_problem)
    with FileLock(Path(os.environ[FOLDER]) / "small surrogate.lock"):
        engine.prepare()
    return engine


@pytest.fixture(scope="session")
def corridor_folder() -> Path:
    return CORRIDOR


@pytest.fixture(scope="session")
def corridor() -> "Scenario":
    from sim_adapters.scenario.scenario import read_scenario

    return read_scenario(CORRIDOR / "scenario/scenario.sumocfg", "ego", 720.0)


@pytest.fixture
def own_corridor(tmp_path: Path) -> Path:
    """A copy of the corridor's scenario to be spoilt."""
    return Path(shutil.copytree(CORRIDOR / "scenario", tmp_path / "case/scenario")).parent


@pytest.fixture(scope="session")
def layout() -> "ParameterLayout":
    from sim_adapters.interface import ParameterLayout

    return ParameterLayout(
        input_ids=("main", "on1"),
        input_flows=(("f_main_o1", "f_main_e"), ("f_on1_o1", "f_on1_e")),
        vtypes=("car",),
        attributes=("tau", "minGap", "accel", "speedFactor", "speedDev", "lcStrategic", "lcSpeedGain"),
    )


@pytest.fixture(scope="session")
def template(corridor: "Scenario", layout: "ParameterLayout") -> "WorldTemplate":
    from sim_adapters.world.world_builder import build_template

    return build_template(corridor, layout)


@pytest.fixture(scope="session")
def two_drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The corridor with two of its drives, one to fit and one held out; whoever alters it copies it first."""
    return copy_corridor(tmp_path_factory.mktemp("case") / "corridor", "d01", "d03")


@pytest.fixture(scope="session")
def problem(two_drives: Path) -> "CalibrationProblem":
    from jaxcalib.problem.problem import read_problem

    return read_problem(two_drives)


@pytest.fixture(scope="session")
def corridor_world(template: "WorldTemplate") -> Callable[..., "World"]:
    """Return a function that makes a world of the corridor from named parameters; the others are the scenario's."""
    import jax.numpy as jnp

    def make(seed: int, depart_s: float, effects: "Effects | None" = None, **changes: float) -> "World":
        values = dict(zip(template.layout.names, template.base_values(), strict=True))
        assert not set(changes) - set(values)
        vector = jnp.asarray(list((values | changes).values()), jnp.float32)
        return template.world(vector, jnp.asarray(seed, jnp.int32), jnp.asarray(depart_s, jnp.float32), effects)

    return make


@pytest.fixture(scope="session")
def drive_on() -> Callable[["World", int], list["TrafficState"]]:
    """Return a function that runs a world from the empty road and keeps the state after every decision interval."""
    import jax

    from surrogate.loop.moving import move_on
    from surrogate.loop.step import initial_state, settle_lanes
    from surrogate.loop.world import Clock
    from tests.jit_marked import jit_marked

    clock, capacity = Clock(step_s=0.1, steps_per_decision=10), 288

    def advance(state: "TrafficState", world: "World") -> "TrafficState":
        return move_on(settle_lanes(state, world, clock), world, clock.step_s, clock.steps_per_decision)

    decide = jit_marked(advance)
    begin = jax.jit(lambda world: initial_state(world, capacity))

    def run(world: "World", num_decisions: int) -> list["TrafficState"]:
        states = [begin(world)]
        for _ in range(num_decisions):
            states.append(decide(states[-1], world))
        return [jax.device_get(state) for state in states]

    return run


@pytest.fixture(scope="session")
def as_users_do() -> dict[str, str]:
    """Return the environment of a process whose programs the compiler makes as it does for users."""
    return os.environ | {"XLA_FLAGS": GIVEN_FLAGS}


@pytest.fixture(scope="module")
def programs_as_users_do() -> Iterator[None]:
    """Programs of this process are made as for users, where bits count: at the lowest level no loop is vectorised.

    Nobody else finds them, for a kept program's name does not tell them apart.
    """
    from jaxcalib.problem import engines
    from sim_adapters.jax import batch_program
    from surrogate.xla.materialise import compiler_options
    from tests.jit_marked import AS_USERS_DO

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch_program, "compiler_options", lambda: compiler_options() | AS_USERS_DO)
        patch.setattr(engines, "program_store", lambda: None)
        yield


@pytest.fixture(scope="session")
def start_sumo() -> Callable[..., subprocess.Popen]:
    """Return a function that starts SUMO beside the tests: until when, whose leaders go into which file, options."""
    script = ROOT / "tests/sim_adapters/sumo/plain_sumo.py"

    def start(end_s: float, subject_vehicle: str, leaders: Path | None, *options: str | Path) -> subprocess.Popen:
        command = [sys.executable, script, str(end_s), subject_vehicle, str(leaders or os.devnull)]
        environment = os.environ | {"LIBSUMO_AS_TRACI": "quiet"}
        return subprocess.Popen([str(part) for part in (*command, *options)], env=environment)

    return start
