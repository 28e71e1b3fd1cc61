"""Where, when and how fast vehicles enter: the surrogate against SUMO itself, for ways of all kinds at once."""

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.world.queues import queues_of
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.inflow.inflow import ENTRANCE_STRIDE, subject_identity
from surrogate.loop.moving import move_on
from surrogate.loop.step import initial_state, settle_lanes
from surrogate.loop.world import Clock
from surrogate.road.traffic_state import TrafficState
from tests.jit_marked import jit_marked
from tests.places import CORRIDOR

pytestmark = pytest.mark.long

END_S, DEPART_S = 240.0, 150.5
NUM_SEEDS = 4
PLAIN = 'departLane="best" departPos="last" departSpeed="avg"'
MAIN, RAMP = 'route="r_main_e"', 'route="r_on1_e"'
# flow or vehicle: its part of the file; the first two of the file's own flows stay away
MIXED = {
    "given": f'<flow id="given" type="car" {MAIN} begin="20" end="120" period="8" departLane="1" departPos="42" '
    'departSpeed="12.5"/>',
    "behind_end": f'<flow id="behind_end" type="car" {MAIN} begin="60" end="200" period="exp(0.1)" departLane="2" '
    'departPos="-15" departSpeed="max"/>',
    "usual": f'<flow id="usual" type="car" {MAIN} begin="0" end="100" vehsPerHour="700"/>',
    "later": f'<flow id="later" type="car" {MAIN} begin="100" end="220" vehsPerHour="1400"/>',
    "standing": f'<flow id="standing" type="car" {RAMP} begin="30" end="150" number="40" departLane="first" '
    'departPos="base" departSpeed="0"/>',
    "any": f'<flow id="any" type="car" {RAMP} begin="150" end="230" period="4" departPos="random" '
    'departSpeed="random"/>',
}
SINGLE_S = (33.0, 34.5, 90.25, 131.0)
LENGTH_M = 4.8  # of all vehicles of the corridor


@dataclass(frozen=True)
class Entry:
    """Who entered when, where and how fast; by the name of the flow."""

    time_s: float
    row: int
    position_m: float
    speed_mps: float
    speed_factor: float


Entries = dict[str, list[Entry]]


def scenario_with(folder: Path, change: Callable[[str], str]) -> Scenario:
    copied = Path(shutil.copytree(CORRIDOR / "scenario", folder / "case/scenario")).parent
    demand = copied / "scenario/demand.rou.xml"
    demand.write_text(change(demand.read_text()))
    return read_scenario(copied / "scenario/scenario.sumocfg", "ego", END_S)


def mixed_demand(text: str) -> str:
    text = re.sub(r"<flow .*\n", "", text).replace(f'depart="300" {PLAIN}', f'depart="{DEPART_S}" departSpeed="8"')
    singles = "".join(
        f'<vehicle id="single{n}" type="car" {MAIN} depart="{time_s}" departLane="0" departSpeed="desired"/>'
        for n, time_s in enumerate(SINGLE_S)
    )
    assert f'depart="{DEPART_S}"' in text
    movers = sorted(re.findall(r"<(?:vehicle|flow)[^>]*/>", "".join(MIXED.values()) + singles), key=begin_of)
    ego = re.search(r"<vehicle id=\"ego\"[^>]*/>", text)
    assert ego is not None
    movers = sorted([*movers, ego[0]], key=begin_of)
    return text.replace(ego[0], "\n".join(movers))


def begin_of(element: str) -> float:
    found = re.search(r'(?:begin|depart)="([\d.]+)"', element)
    assert found is not None
    return float(found[1])


def entries_in_sumo(start_sumo: Callable[..., subprocess.Popen], scenario: Scenario, folder: Path) -> list[Entries]:
    runs = []
    for seed in range(1, NUM_SEEDS + 1):
        file = folder / f"trips{seed}.xml"
        run = start_sumo(
            END_S, "ego", None, "-c", scenario.configuration.file, "--seed", str(seed), "--tripinfo-output", file,
            "--tripinfo-output.write-unfinished", "true",
        )  # fmt: skip
        assert run.wait() == 0
        entries: Entries = {}
        for trip in ElementTree.parse(file).getroot().iter("tripinfo"):
            edge, _, lane = trip.get("departLane", "").rpartition("_")
            name = re.sub(r"\.?\d+$", "", trip.get("id", ""))
            entry = Entry(
                float(trip.get("depart", "nan")),
                scenario.row_map.row_of_lane[(edge, int(lane))],
                scenario.network.edge_start_m(edge) + float(trip.get("departPos", "nan")),
                float(trip.get("departSpeed", "nan")),
                float(trip.get("speedFactor", "nan")),
            )
            entries.setdefault(name, []).append(entry)
        runs.append(entries)
    return runs


def drive(template: WorldTemplate, steps_per_decision: int, capacity: int = 288) -> list[tuple]:
    """Return, for each seed, what is seen right after each decision: see `one`."""
    clock = Clock(step_s=0.1, steps_per_decision=steps_per_decision)
    values = jnp.asarray(template.base_values(), jnp.float32)

    @jit_marked
    def run(seed: jax.Array) -> tuple:
        world = template.world(values, seed, jnp.asarray(DEPART_S, jnp.float32))

        def one(state: TrafficState, _: None) -> tuple:
            state = settle_lanes(state, world, clock)
            v = state.vehicles
            seen = v.identity, v.vehicle_class, v.row, v.position_m, v.speed_mps, v.speed_factor
            seen = *seen, state.num_arrived, state.num_inserted
            return move_on(state, world, clock.step_s, clock.steps_per_decision), seen

        number = round(END_S / clock.interval_s)
        last, seen = jax.lax.scan(one, initial_state(world, capacity, clock), None, length=number)
        return seen, last.num_lost, last.num_collisions

    runs = []
    for seed in range(1, NUM_SEEDS + 1):
        seen, num_lost, num_collisions = jax.device_get(run(jnp.asarray(seed, jnp.int32)))
        assert num_lost == num_collisions == 0
        runs.append(seen)
    return runs


def entries_in_surrogate(scenario: Scenario, template: WorldTemplate, runs: list, interval_s: float) -> list[Entries]:
    queues = queues_of(scenario)
    assert template.schedule is not None
    column = np.asarray(template.schedule.flow)
    subject = subject_identity(len(queues))
    found = []
    for identity, vehicle_class, *numbers, _, _ in runs:
        entries: Entries = {}
        known: set[int] = set()
        for instant in range(len(identity)):
            for entry in np.flatnonzero(vehicle_class[instant] >= 0):
                who = int(identity[instant, entry])
                if who in known:
                    continue
                known.add(who)
                queue, place = divmod(who, ENTRANCE_STRIDE)
                name = "ego" if who == subject else queues[queue].flows[column[queue, place]].id
                name = "single" if name.startswith("vehicles of") else name
                row, position_m, speed_mps, speed_factor = (float(values[instant, entry]) for values in numbers)
                at = Entry(instant * interval_s, int(row), position_m, speed_mps, speed_factor)
                entries.setdefault(name, []).append(at)
        found.append(entries)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("entering")


@pytest.fixture(scope="module")
def mixed(folder: Path) -> Scenario:
    return scenario_with(folder / "mixed", mixed_demand)


@pytest.fixture(scope="module")
def in_sumo(start_sumo: Callable[..., subprocess.Popen], mixed: Scenario, folder: Path) -> list[Entries]:
    return entries_in_sumo(start_sumo, mixed, folder)


@pytest.fixture(scope="module")
def in_surrogate(mixed: Scenario) -> list[Entries]:
    """Decided step by step, so that each is seen where it enters."""
    template = build_template(mixed, ParameterLayout((), (), (), ()))
    return entries_in_surrogate(mixed, template, drive(template, 1), 0.1)


def of(runs: list[Entries], name: str, what: str) -> np.ndarray:
    return np.asarray([getattr(entry, what) for entries in runs for entry in entries.get(name, [])])


def counts(runs: list[Entries], name: str) -> list[int]:
    return [len(entries.get(name, [])) for entries in runs]


@pytest.mark.parametrize("name", ["given", "usual", "later", "standing", "any", "single", "ego"])
def test_as_many_enter_of_each_flow_where_arrivals_are_regular(
    in_sumo: list[Entries], in_surrogate: list[Entries], name: str
) -> None:
    ours, theirs = counts(in_surrogate, name), counts(in_sumo, name)
    assert abs(np.mean(ours) - np.mean(theirs)) <= 1.0
    assert min(theirs) > 0


def test_random_arrivals_are_as_many_within_chance(in_sumo: list[Entries], in_surrogate: list[Entries]) -> None:
    expected = 0.1 * 140.0
    for runs in (in_sumo, in_surrogate):
        assert abs(np.mean(counts(runs, "behind_end")) - expected) < 4.0 * np.sqrt(expected / NUM_SEEDS)


def test_nobody_enters_before_his_time(in_sumo: list[Entries], in_surrogate: list[Entries]) -> None:
    for runs in (in_sumo, in_surrogate):
        for name, part in MIXED.items():
            assert of(runs, name, "time_s").min() >= begin_of(part)
        assert of(runs, "ego", "time_s").min() >= DEPART_S


def test_single_vehicles_enter_at_their_second_or_as_soon_after_as_there_is_room(
    in_sumo: list[Entries], in_surrogate: list[Entries]
) -> None:
    longest_s = 5.0  # of a queue of one on a lane with a vehicle each 10 s, here those of others who enter there
    for runs in (in_sumo, in_surrogate):
        for entries in runs:
            waited_s = np.sort([entry.time_s for entry in entries["single"]]) - SINGLE_S
            assert (waited_s >= 0.0).all()
            assert waited_s.max() < longest_s
            assert waited_s.min() < 0.1


@pytest.mark.parametrize(
    ("name", "rows"), [("given", {1}), ("behind_end", {2}), ("standing", {3}), ("single", {0}), ("usual", {0, 1, 2})]
)
def test_the_lane_is_the_one_that_is_asked_for(
    in_sumo: list[Entries], in_surrogate: list[Entries], name: str, rows: set[int]
) -> None:
    assert set(of(in_surrogate, name, "row").astype(int)) == set(of(in_sumo, name, "row").astype(int)) == rows


@pytest.mark.parametrize("name", ["given", "behind_end", "usual", "later", "standing", "single", "ego"])
def test_the_place_is_the_one_that_is_asked_for(in_sumo: list[Entries], in_surrogate: list[Entries], name: str) -> None:
    ours, theirs = of(in_surrogate, name, "position_m"), of(in_sumo, name, "position_m")
    np.testing.assert_allclose(ours, theirs[0], atol=0.02)  # SUMO writes two digits
    np.testing.assert_allclose(theirs, theirs[0], atol=0.02)


def test_a_random_place_is_anywhere_on_the_edge(
    mixed: Scenario, in_sumo: list[Entries], in_surrogate: list[Entries]
) -> None:
    start_m, end_m = mixed.network.edge_start_m("in1"), mixed.network.edge_end_m("in1")
    for runs in (in_sumo, in_surrogate):
        share = (of(runs, "any", "position_m") - start_m) / (end_m - start_m)
        assert abs(share.mean() - 0.5) < 4.0 * np.sqrt(1.0 / 12.0 / len(share))
        assert 0.0 <= share.min() < 0.25
        assert 0.75 < share.max() <= 1.0


def test_a_given_speed_is_the_speed(in_sumo: list[Entries], in_surrogate: list[Entries]) -> None:
    for runs in (in_sumo, in_surrogate):
        for name, speed_mps in (("given", 12.5), ("standing", 0.0), ("ego", 8.0)):
            np.testing.assert_allclose(of(runs, name, "speed_mps"), speed_mps, atol=0.01)


@pytest.mark.parametrize("name", ["behind_end", "usual", "later", "any", "single"])
def test_other_speeds_are_the_same_in_the_mean(in_sumo: list[Entries], in_surrogate: list[Entries], name: str) -> None:
    ours, theirs = of(in_surrogate, name, "speed_mps"), of(in_sumo, name, "speed_mps")
    chance = np.hypot(ours.std() / np.sqrt(len(ours)), theirs.std() / np.sqrt(len(theirs)))
    assert abs(ours.mean() - theirs.mean()) < 4.0 * chance


def test_faster_drivers_enter_further_to_the_left(in_sumo: list[Entries], in_surrogate: list[Entries]) -> None:
    """SUMO's default, departLane "best_prob": nobody enters left of one who wants to be faster."""
    for runs in (in_sumo, in_surrogate):
        row, wanted = of(runs, "later", "row"), of(runs, "later", "speed_factor")
        assert wanted[row == 0].mean() < wanted[row > 0].mean() - 0.02


def test_as_many_get_onto_a_full_road(start_sumo: Callable[..., subprocess.Popen], folder: Path) -> None:
    """Twice what fits: the surrogate, which decides each second, lets in as many as SUMO does at each of its steps."""

    def crowded(text: str) -> str:
        text = re.sub(r"exp\(([\d.]+)\)", lambda rate: f"exp({2.5 * float(rate[1]):.4f})", text)
        return text.replace(PLAIN, "")

    scenario = scenario_with(folder / "crowded", crowded)
    template = build_template(scenario, ParameterLayout((), (), (), ()))
    runs = drive(template, 10, 640)
    ours = np.asarray([template.of_entrances(seen[-1][-1]) for seen in runs])
    waiting = np.asarray([template.of_entrances(seen[-2][-1] - seen[-1][-1]) for seen in runs])
    theirs = [
        sum(len(entries.get(flow, [])) for flow in ("f_main_o1", "f_main_e"))
        for entries in entries_in_sumo(start_sumo, scenario, folder)
    ]
    assert waiting[:, 0].min() > 100
    assert ours[:, 0].mean() == pytest.approx(np.mean(theirs), rel=0.06)
