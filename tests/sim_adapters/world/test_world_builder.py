"""The corridor's world against what its files say."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.road_builder import CELL_LENGTH_M
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.loop.world import World


@pytest.fixture(scope="module")
def demand(corridor_folder: Path) -> ElementTree.Element:
    return ElementTree.parse(corridor_folder / "scenario/demand.rou.xml").getroot()


@pytest.fixture(scope="module")
def rates_vehps(demand: ElementTree.Element) -> dict[str, float]:
    return {f.get("id", ""): float(re.findall(r"exp\((.*)\)", f.get("period", ""))[0]) for f in demand.iter("flow")}


def vector(template: WorldTemplate, **changes: float) -> jax.Array:
    values = dict(zip(template.layout.names, template.base_values(), strict=True))
    return jnp.asarray(list((values | changes).values()), jnp.float32)


def test_the_base_values_are_the_scenario_s_own(
    template: WorldTemplate, demand: ElementTree.Element, rates_vehps: dict[str, float]
) -> None:
    car = next(vtype for vtype in demand.iter("vType") if vtype.get("id") == "car")
    main = 3600.0 * (rates_vehps["f_main_o1"] + rates_vehps["f_main_e"])
    on_ramp = 3600.0 * (rates_vehps["f_on1_o1"] + rates_vehps["f_on1_e"])
    attributes = [float(car.get(name, "nan")) for name in template.layout.attributes]
    np.testing.assert_allclose(template.base_values(), [main, on_ramp, *attributes], rtol=1e-12)


def test_the_base_vector_gives_the_demand_and_shares_of_the_flows(
    corridor_world: Callable[..., World], rates_vehps: dict[str, float]
) -> None:
    world = corridor_world(1, 60.0)
    pairs = [("f_main_o1", "f_main_e"), ("f_on1_o1", "f_on1_e")]
    total = [sum(rates_vehps[flow] for flow in pair) for pair in pairs]
    np.testing.assert_allclose(world.demand_vehps, total, rtol=1e-6)
    first = [rates_vehps[pair[0]] / whole for pair, whole in zip(pairs, total, strict=True)]
    np.testing.assert_allclose(world.inflow.flow_share, np.stack([first, [1.0, 1.0]], axis=1), rtol=1e-6)
    np.testing.assert_array_equal(world.inflow.flow_destination, [[1, 0], [1, 0]])


def test_an_input_scales_its_own_entrance_and_keeps_the_shares(corridor_world: Callable[..., World]) -> None:
    base, changed = corridor_world(1, 60.0), corridor_world(1, 60.0, on1=913.0)
    assert float(changed.demand_vehps[1]) == pytest.approx(913.0 / 3600.0, rel=1e-5)
    assert float(changed.demand_vehps[0]) == float(base.demand_vehps[0])
    np.testing.assert_allclose(changed.inflow.flow_share, base.inflow.flow_share, rtol=1e-6)


def test_an_input_that_scales_one_flow_of_an_entrance_changes_the_shares(
    corridor: Scenario, rates_vehps: dict[str, float]
) -> None:
    layout = ParameterLayout(("out",), (("f_main_o1", "f_on1_o1"),), ("car",), ())
    template = build_template(corridor, layout)
    base = 3600.0 * (rates_vehps["f_main_o1"] + rates_vehps["f_on1_o1"])
    assert template.base_values() == pytest.approx([base], rel=1e-12)
    world = template.world(jnp.asarray([3.0 * base], jnp.float32), jnp.asarray(1), jnp.asarray(60.0))
    leaving = 3.0 * np.asarray([rates_vehps["f_main_o1"], rates_vehps["f_on1_o1"]])
    staying = np.asarray([rates_vehps["f_main_e"], rates_vehps["f_on1_e"]])
    np.testing.assert_allclose(world.demand_vehps, leaving + staying, rtol=1e-5)
    np.testing.assert_allclose(world.inflow.flow_share[:, 0], leaving / (leaving + staying), rtol=1e-5)


def test_without_any_demand_the_world_stays_finite(corridor_world: Callable[..., World]) -> None:
    world = corridor_world(1, 60.0, main=0.0, on1=0.0)
    assert np.asarray(world.demand_vehps).tolist() == [0.0, 0.0]
    assert np.isfinite(np.asarray(world.inflow.flow_share)).all()


def test_behaviour_changes_the_named_vtype_and_never_the_subject_vehicle(
    corridor_world: Callable[..., World], demand: ElementTree.Element
) -> None:
    world = corridor_world(1, 60.0, tau=1.83, minGap=3.1, accel=0.97, speedFactor=1.13, lcStrategic=4.2)
    car, subject = world.classes
    found = [
        car.car_following.time_gap_s, car.car_following.jam_gap_m, car.car_following.max_acceleration_mps2,
        car.speed_factor_mean, car.lane_change.strategic,  # pyright: ignore[reportAttributeAccessIssue]
    ]  # fmt: skip
    np.testing.assert_allclose(found, [1.83, 3.1, 0.97, 1.13, 4.2], rtol=1e-6)
    written = next(vtype for vtype in demand.iter("vType") if vtype.get("id") == "subject")
    model = subject.car_following
    found = [model.time_gap_s, model.jam_gap_m, model.max_acceleration_mps2, subject.max_speed_mps]
    expected = [float(written.get(name, "nan")) for name in ("tau", "minGap", "accel", "maxSpeed")]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_even_if_its_vtype_is_named_the_subject_vehicle_stays_as_it_is(
    corridor: Scenario, layout: ParameterLayout, template: WorldTemplate
) -> None:
    both = build_template(corridor, replace(layout, vtypes=("car", "subject")))
    changed = vector(template, tau=1.83, minGap=3.1, accel=0.97)
    car, subject = both.world(changed, jnp.asarray(1), jnp.asarray(60.0)).classes
    own = template.class_values[-1]
    assert float(car.car_following.time_gap_s) == pytest.approx(1.83)
    assert float(subject.car_following.time_gap_s) == pytest.approx(own["tau"]) != pytest.approx(1.83)
    assert float(subject.car_following.jam_gap_m) == pytest.approx(own["minGap"]) != pytest.approx(3.1)


def test_each_leaf_without_a_batch_axis_is_the_same_in_all_runs(template: WorldTemplate) -> None:
    vectors = jnp.stack([vector(template), vector(template, main=2100.0, tau=1.7), vector(template, on1=77.0)])
    seeds, departs_s = jnp.asarray([4, 5, 6]), jnp.asarray([60.0, 71.0, 90.0])
    axes = template.batch_axes()
    batch = jax.vmap(template.world, out_axes=axes)(vectors, seeds, departs_s)

    def single_of(leaf: jax.Array, axis: int | None, run: int) -> jax.Array:
        return leaf if axis is None else leaf[run]

    is_none = {"is_leaf": lambda node: node is None}
    for run in range(3):
        alone = template.world(vectors[run], seeds[run], departs_s[run])
        from_batch = jax.tree.map(lambda a, w, r=run: jax.tree.map(lambda leaf: single_of(leaf, a, r), w),
                                  axes, batch, **is_none)  # fmt: skip
        for one, other in zip(jax.tree.leaves(alone), jax.tree.leaves(from_batch), strict=True):
            np.testing.assert_allclose(np.asarray(one), np.asarray(other), rtol=1e-6)


def test_the_entrances_are_the_first_lanes_of_carriageway_and_ramp(template: WorldTemplate, corridor: Scenario) -> None:
    assert corridor.entrances == ("in0", "in1")
    for entrance, edge in enumerate(corridor.entrances):
        rows = template.lane_row[entrance]
        lanes = corridor.network.edge_lanes(edge)
        assert rows[: len(lanes)].tolist() == [corridor.row_map.row_of_lane[lane.key] for lane in lanes]
        assert (rows[len(lanes) :] == -1).all()
        assert not template.serves[entrance, :, len(lanes) :].any()
        assert template.edge_m[entrance].tolist() == [lanes[0].start_m, lanes[0].end_m]
    assert template.window_s.tolist() == [[0.0, 720.0], [0.0, 720.0]]
    assert template.serves.any(axis=2).all()


def places_to_look_up(ends: np.ndarray) -> np.ndarray:
    """Return positions all along the road, on the borders and just before them."""
    anywhere = np.random.default_rng(2).uniform(-30.0, 3400.0, 20_000).astype(np.float32)
    return np.concatenate([anywhere, ends[:-1], np.nextafter(ends[:-1], np.float32(0.0))])


def test_positions_are_looked_up_in_the_segment_that_holds_them(template: WorldTemplate) -> None:
    ends = np.asarray(template.road.segment_end_m)
    position = places_to_look_up(ends)
    behind_short = np.zeros(len(position), bool)
    for end in ends[1:-1][np.diff(ends[:-1]) < CELL_LENGTH_M]:
        behind_short |= (position >= end) & (position < end + CELL_LENGTH_M)
    position = position[~behind_short]
    expected = np.searchsorted(ends, position, side="right")
    np.testing.assert_array_equal(np.asarray(template.road.segment_at(jnp.asarray(position))), expected)


def test_positions_right_behind_a_short_segment_are_looked_up_in_theirs(template: WorldTemplate) -> None:
    ends = np.asarray(template.road.segment_end_m)
    position = places_to_look_up(ends)
    expected = np.searchsorted(ends, position, side="right")
    np.testing.assert_array_equal(np.asarray(template.road.segment_at(jnp.asarray(position))), expected)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"input_flows": (("f_main_o1", "f_nowhere"), ("f_on1_o1", "f_on1_e"))}, "input 'main'.*f_nowhere"),
        ({"vtypes": ("car", "lorry")}, "lorry"),
    ],
)
def test_a_layout_that_names_what_the_scenario_lacks_is_refused(
    corridor: Scenario, layout: ParameterLayout, change: dict[str, tuple], named: str
) -> None:
    with pytest.raises(ScenarioError, match=named):
        build_template(corridor, replace(layout, **change))


def test_lanes_beside_one_another_are_so_from_both_sides(template: WorldTemplate) -> None:
    """Where an exit's lanes begin within the junction, nobody can change onto the exit from the carriageway."""
    left, right = np.asarray(template.road.left_row), np.asarray(template.road.right_row)
    for there, back in ((left, right), (right, left)):
        row, segment = np.nonzero(there >= 0)
        assert len(row) > 0
        np.testing.assert_array_equal(back[there[row, segment], segment], row)


def test_whoever_needs_two_changes_stops_in_time_to_make_the_second(template: WorldTemplate) -> None:
    """As SUMO does: 20 m before the end of the lane."""
    road = template.road
    offset, stop_m = np.asarray(road.best_lane_offset), np.asarray(road.stop_position_m)
    must_leave = np.isfinite(stop_m)
    one, more = must_leave & (np.abs(offset) == 1), must_leave & (np.abs(offset) > 1)
    ends = np.unique(stop_m[one & (offset < 0)])  # the diverge, seen from the lane beside the exit's
    assert len(ends) == 1
    assert more.any()
    np.testing.assert_allclose(stop_m[more], ends[0] - 20.0)
