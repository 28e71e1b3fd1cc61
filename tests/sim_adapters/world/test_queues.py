"""The queues before a scenario's entrances, where not all enter in the plain way."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.demand_elements import Departure
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.world.departures import departure_of, lanes_of
from sim_adapters.world.queues import is_plain, queues_of
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.effects.base import EffectSetting
from surrogate.effects.settings import Effects, settings_table
from surrogate.inflow.departure import Position, Speed

PLAIN = 'departLane="best" departPos="last" departSpeed="avg"'
MAIN, RAMP = ("f_main_o1", "f_main_e"), ("f_on1_o1", "f_on1_e")
SINGLE = '<vehicle id="v{0}" type="car" route="r_main_e" depart="{1}" departLane="0"/>'


def scenario(case: Path, *changes: tuple[str, str]) -> Scenario:
    file = case / "scenario/demand.rou.xml"
    for old, new in changes:
        text = file.read_text()
        assert old in text
        file.write_text(text.replace(old, new, 1))
    return read_scenario(case / "scenario/scenario.sumocfg", "ego", 720.0)


@pytest.fixture
def mixed(own_corridor: Path) -> Scenario:
    """Two windows on the ramp, another departure of a flow on the carriageway, and three single vehicles."""
    singles = "".join(SINGLE.format(n, depart_s) for n, depart_s in enumerate((12.5, 13.0, 400.0)))
    return scenario(
        own_corridor,
        (f'period="exp(0.130000)" {PLAIN}', 'period="exp(0.130000)" departLane="2" departSpeed="max"'),
        ('route="r_on1_e" begin="0" end="720"', 'route="r_on1_e" begin="100" end="300"'),
        ("<vehicle ", f"{singles}<vehicle "),
    )


@pytest.fixture
def template(mixed: Scenario) -> WorldTemplate:
    return build_template(
        mixed, ParameterLayout(("main", "on1"), ((*MAIN, "vehicles of in0"), RAMP), ("car",), ("tau",))
    )


def test_the_corridor_needs_nothing_of_this(corridor: Scenario, layout: ParameterLayout) -> None:
    assert is_plain(corridor)
    plain = build_template(corridor, layout)
    assert plain.schedule is plain.rules is plain.entrance_of_queue is None
    assert [queue.edge for queue in queues_of(corridor)] == ["in0", "in1"]


@pytest.mark.parametrize(
    ("old", "new", "plain"),
    [
        ('end="720" period="exp(0.130000)"', 'end="719" period="exp(0.130000)"', False),
        ("<vehicle ", SINGLE.format(0, 9) + "<vehicle ", False),
        (f'depart="300" {PLAIN}', f'depart="300" {PLAIN.replace("last", "base")}', False),
        (f'depart="300" {PLAIN}', 'depart="300" departLane="best" departPos="last"', True),  # SUMO's own is "avg"
    ],
)
def test_one_other_window_or_departure_is_enough(own_corridor: Path, old: str, new: str, plain: bool) -> None:
    assert is_plain(scenario(own_corridor, (old, new))) == plain


def test_who_waits_for_other_lanes_waits_in_another_queue(mixed: Scenario, template: WorldTemplate) -> None:
    queues = queues_of(mixed)
    assert [(queue.edge, queue.lane) for queue in queues] == [
        ("in0", "best"),
        ("in0", "2"),
        ("in1", "best"),
        ("in0", "0"),
    ]
    assert [len(queue.vehicles) for queue in queues] == [0, 0, 0, 3]
    for number, lane in ((1, 2), (3, 0)):
        assert np.flatnonzero(template.serves[number, 0]).tolist() == [lane]
    assert template.entrance_of_queue is not None
    counted = template.of_entrances(np.asarray([5, 7, 11, 13]))
    assert counted.tolist() == [5 + 7 + 13, 11]  # SUMO counts by edge


def test_an_input_scales_single_vehicles_and_flows_alike(template: WorldTemplate) -> None:
    base = template.base_values()

    def number_of(factor: float) -> np.ndarray:
        values = jnp.asarray(base * [factor, 1.0, 1.0], jnp.float32)
        table = template.world(values, jnp.asarray(3), jnp.asarray(300.0)).inflow.timetable
        assert table is not None
        return np.isfinite(np.asarray(table.time_s)).sum(axis=1)

    once, twice = number_of(1.0), number_of(2.0)
    assert once[3] == 3
    assert twice[3] == 6
    assert twice[2] == once[2]  # of the other input
    expected = 720.0 * 0.953333
    assert abs(once[0] - expected) < 4.0 * np.sqrt(expected)
    assert abs(twice[0] - 2.0 * expected) < 4.0 * np.sqrt(2.0 * expected)


def test_vehicles_that_come_in_platoons_are_as_many(template: WorldTemplate) -> None:
    """Platoons are on the carriageway, where headways become uneven; the ramp knows nothing of them."""
    values, depart_s = jnp.asarray(template.base_values(), jnp.float32), jnp.asarray(300.0)
    settings = {"platooned_arrivals": EffectSetting(0.6)}

    def times_s(effects: Effects | None, seed: int) -> np.ndarray:
        table = template.world(values, jnp.asarray(seed), depart_s, effects).inflow.timetable
        assert table is not None
        return np.asarray(table.time_s)

    effects = Effects(jnp.asarray(settings_table(settings)))
    runs = [(times_s(None, seed), times_s(effects, seed)) for seed in range(1, 13)]
    numbers = np.asarray([[np.isfinite(one[0]).sum() for one in pair] for pair in runs])
    assert abs(numbers[:, 1].mean() - 720.0 * 0.953333) < 4.0 * numbers[:, 1].std(ddof=1) / np.sqrt(len(runs))
    uneven = [[np.var(gaps) / np.mean(gaps) ** 2 for gaps in map(headways_s, pair)] for pair in runs]
    assert np.mean(uneven, axis=0)[1] > np.mean(uneven, axis=0)[0] + 0.1
    for plain, bunched in runs:
        np.testing.assert_array_equal(plain[2], bunched[2])


def headways_s(time_s: np.ndarray) -> np.ndarray:
    return np.diff(time_s[0][np.isfinite(time_s[0])])


def test_flows_come_in_their_windows(template: WorldTemplate) -> None:
    world = template.world(jnp.asarray(template.base_values(), jnp.float32), jnp.asarray(8), jnp.asarray(300.0))
    table = world.inflow.timetable
    assert table is not None
    time_s, flow = np.asarray(table.time_s)[2], np.asarray(table.flow)[2][np.asarray(table.place)[2]]
    late = time_s[(flow == 1) & np.isfinite(time_s)]
    assert late.min() >= 100.0
    assert late.max() < 300.0
    expected = 200.0 * 0.127111
    assert abs(len(late) - expected) < 4.0 * np.sqrt(expected)


def test_each_leaf_without_a_batch_axis_is_the_same_in_all_runs(template: WorldTemplate) -> None:
    base = template.base_values()
    vectors = jnp.asarray([base, base * [1.2, 0.9, 1.0], base * [0.8, 1.3, 1.1]], jnp.float32)
    seeds, departs_s = jnp.asarray([4, 5, 6]), jnp.asarray([60.0, 71.0, 90.0])
    axes = template.batch_axes()
    batch = jax.vmap(template.world, out_axes=axes)(vectors, seeds, departs_s)
    for run in range(3):
        alone = template.world(vectors[run], seeds[run], departs_s[run])
        for own, all_runs in zip(jax.tree.leaves(alone), jax.tree.leaves(batch), strict=True):
            leaf = all_runs if all_runs.shape == own.shape else all_runs[run]
            np.testing.assert_allclose(np.asarray(leaf), np.asarray(own), rtol=1e-6)


def test_words_of_departures() -> None:
    usual = departure_of(Departure())  # SUMO 1.28's own
    assert (usual.position, usual.speed) == (Position.BASE, Speed.AVERAGE)
    given = departure_of(Departure("0", "-12.5", "0"))
    assert (given.position, given.position_m, given.speed, given.speed_mps) == (Position.GIVEN, -12.5, Speed.GIVEN, 0.0)
    words = [departure_of(Departure("0", "random_free", word)).speed for word in ("desired", "speedLimit", "last")]
    assert words == [Speed.DESIRED, Speed.LIMIT, Speed.LAST]


def test_lanes_of_departures(corridor: Scenario) -> None:
    route = ("in0", "m0", "m1", "m2", "m3", "m4", "m5", "m6", "m7", "m8")
    lanes = {lane: lanes_of(corridor.network, route, lane).tolist() for lane in ("0", "2", "first", "free", "allowed")}
    assert lanes["0"] == lanes["first"] == [True, False, False]
    assert lanes["2"] == [False, False, True]
    assert lanes["free"] == lanes["allowed"] == [True, True, True]
