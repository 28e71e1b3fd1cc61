"""MOBIL's two criteria with numbers worked out by hand, and MOBIL drivers on the corridor."""

from collections.abc import Callable
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.idm import Idm
from surrogate.lane_change.decide import decide
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.mobil import Appraisal, Mobil, appraise
from surrogate.lane_change.surroundings import following_of
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.step import initial_state
from surrogate.loop.world import World
from surrogate.road.traffic_state import TrafficState
from surrogate.vehicle.lane_change_model import LaneChangeModel, Reason
from surrogate.vehicle.vehicle_class import VehicleClass
from tests.jit_marked import jit_marked
from tests.surrogate.lane_change.lane_scene import lane_scene

STEP_S = 0.1
S0, T, A, B, LENGTH = 2.0, 1.5, 1.4, 2.0, 4.6
DESIRED = 33.0
PUBLISHED = {
    "politeness": 0.0,
    "safe_deceleration_mps2": 4.0,
    "changing_threshold_mps2": 0.1,
    "keep_right_bias_mps2": 0.0,
    "european_rule": 0.0,
    "strategic": 1.0,
    "assertive": 1.0,
    "look_ahead_left": 2.0,
}


def mobil(**changes: float) -> Mobil:
    return Mobil(**{name: jnp.asarray(value, jnp.float32) for name, value in (PUBLISHED | changes).items()})


def idm_class(lane_change: LaneChangeModel) -> VehicleClass:
    model = Idm(*(jnp.asarray(value) for value in (S0, T, A, B, 9.0, 4.0)))
    return VehicleClass(model, lane_change, jnp.asarray(LENGTH), jnp.asarray(50.0), jnp.asarray(1.0), jnp.asarray(0.1))


def idm(speed: float, gap: float, leader_speed: float) -> float:
    wanted = S0 + max(0.0, speed * T + speed * (speed - leader_speed) / (2.0 * np.sqrt(A * B)))
    return A * (1.0 - (speed / DESIRED) ** 4 - (wanted / gap) ** 2)


def appraised(
    model: Mobil,
    is_right: bool,
    own_leader: tuple[float, float] | None,
    new_leader: tuple[float, float] | None,
    new_follower: tuple[float, float] | None,
    old_follower: tuple[float, float] | None,
    speed: float = 22.0,
) -> Appraisal:
    """Return the appraisal of one vehicle; neighbours are (gap, speed), or none."""

    ego, side, behind = lane_scene(speed, LENGTH, S0, DESIRED, own_leader, new_leader, new_follower, old_follower)
    zero = jnp.zeros(1, jnp.int32)
    following = following_of(zero, (idm_class(model),))
    return appraise(model, ego, side, behind, following, is_right, STEP_S)


SLOW, ROOM, BEHIND, OLD = (35.0, 18.0), (90.0, 24.0), (30.0, 20.0), (28.0, 21.0)


def test_without_politeness_the_incentive_is_the_own_gain() -> None:
    found = appraised(mobil(), False, SLOW, ROOM, BEHIND, OLD)
    # own leader: s* = 2 + 33 + 22 * 4 / 3.34664 = 61.2951; new leader: s* = 2 + 33 - 22 * 2 / 3.34664 = 21.8525
    gain = 1.4 * ((61.2951 / 35.0) ** 2 - (21.8525 / 90.0) ** 2)
    assert gain == pytest.approx(4.2112, abs=2e-4)
    assert float(found.incentive_mps2[0]) == pytest.approx(gain, abs=2e-4)
    assert float(found.excess_mps2[0]) == pytest.approx(gain - 0.1, abs=2e-4)
    assert bool(found.is_safe[0])
    assert bool(found.wants[0])


def test_with_politeness_the_gains_of_the_old_and_the_new_follower_count() -> None:
    found = appraised(mobil(politeness=0.5), False, SLOW, ROOM, BEHIND, OLD)
    own = idm(22.0, 90.0, 24.0) - idm(22.0, 35.0, 18.0)
    new = idm(20.0, 30.0, 22.0) - idm(20.0, 30.0 + LENGTH + 90.0, 24.0)
    old = idm(21.0, 28.0 + LENGTH + 35.0, 18.0) - idm(21.0, 28.0, 22.0)
    # new: s* = 2 + 30 - 40 / 3.34664 = 20.0477 at 30 m, 2 + 30 - 80 / 3.34664 = 8.0954 at 124.6 m
    assert new == pytest.approx(1.4 * (0.06497**2 - 0.66826**2), abs=2e-4)
    # old: s* = 2 + 31.5 - 21 / 3.34664 = 27.2251 at 28 m, 2 + 31.5 + 63 / 3.34664 = 52.3248 at 67.6 m
    assert old == pytest.approx(1.4 * (0.97233**2 - 0.77403**2), abs=2e-4)
    assert float(found.incentive_mps2[0]) == pytest.approx(own + 0.5 * (new + old), abs=2e-4)
    alone = appraised(mobil(politeness=0.5), False, SLOW, ROOM, None, None)
    assert float(alone.incentive_mps2[0]) == pytest.approx(own, abs=2e-4)


def test_a_polite_driver_leaves_a_gain_to_himself_that_costs_others_more() -> None:
    neighbours = ((60.0, 22.0), (75.0, 22.5), (32.0, 22.5), None)
    own = idm(22.0, 75.0, 22.5) - idm(22.0, 60.0, 22.0)
    new = idm(22.5, 32.0, 22.0) - idm(22.5, 32.0 + LENGTH + 75.0, 22.5)
    assert 0.1 < own < -0.5 * new
    assert bool(appraised(mobil(), False, *neighbours).wants[0])
    polite = appraised(mobil(politeness=0.5), False, *neighbours)
    assert bool(polite.is_safe[0])
    assert not bool(polite.wants[0])


def test_the_decision_flips_exactly_at_the_changing_threshold() -> None:
    gain = float(appraised(mobil(), False, SLOW, ROOM, BEHIND, OLD).incentive_mps2[0])
    for shift, wants in ((-1e-3, True), (1e-3, False)):
        found = appraised(mobil(changing_threshold_mps2=gain + shift), False, SLOW, ROOM, BEHIND, OLD)
        assert bool(found.wants[0]) == wants


def test_no_gain_buys_a_change_that_forces_the_new_follower_to_brake_harder_than_is_safe() -> None:
    follower = (26.0, 24.0)
    forced = idm(24.0, 26.0, 22.0)
    assert -9.0 < forced < -4.0
    found = appraised(mobil(), False, SLOW, ROOM, follower, OLD)
    assert float(found.excess_mps2[0]) > 2.0
    assert not bool(found.wants[0])
    assert not bool(appraised(mobil(safe_deceleration_mps2=-forced - 0.01), False, SLOW, ROOM, follower, OLD).wants[0])
    assert bool(appraised(mobil(safe_deceleration_mps2=-forced + 0.01), False, SLOW, ROOM, follower, OLD).wants[0])


def test_the_bias_draws_to_the_right_and_keeps_from_the_left() -> None:
    alike = (80.0, 22.0)
    for bias, right, left in ((0.0, False, False), (0.3, True, False), (-0.3, False, True)):
        model = mobil(keep_right_bias_mps2=bias)
        for is_right, wants in ((True, right), (False, left)):
            found = appraised(model, is_right, alike, alike, None, None)
            assert float(found.incentive_mps2[0]) == pytest.approx(0.0, abs=1e-6)
            assert float(found.excess_mps2[0]) == pytest.approx(-0.1 + (bias if is_right else -bias), abs=1e-6)
            assert bool(found.wants[0]) == wants


def test_by_the_european_rule_nobody_counts_in_the_right_lane() -> None:
    model = mobil(politeness=0.5, european_rule=1.0)
    slow = (35.0, 15.0)  # slower than 60 km/h: one may pass on the right
    left = appraised(model, False, slow, ROOM, BEHIND, OLD)
    right = appraised(model, True, slow, ROOM, BEHIND, OLD)
    own = idm(22.0, 90.0, 24.0) - idm(22.0, 35.0, 15.0)
    new = idm(20.0, 30.0, 22.0) - idm(20.0, 30.0 + LENGTH + 90.0, 24.0)
    old = idm(21.0, 28.0 + LENGTH + 35.0, 15.0) - idm(21.0, 28.0, 22.0)
    assert float(left.incentive_mps2[0]) == pytest.approx(own + 0.5 * new, abs=3e-4)
    assert float(right.incentive_mps2[0]) == pytest.approx(own + 0.5 * old, abs=3e-4)
    half = appraised(mobil(politeness=0.5, european_rule=0.5), False, slow, ROOM, BEHIND, OLD)
    assert float(half.incentive_mps2[0]) == pytest.approx(own + 0.5 * new + 0.25 * old, abs=3e-4)


def test_by_the_european_rule_a_free_right_lane_is_no_way_past_a_slower_leader_in_the_left() -> None:
    slower = (35.0, 18.0)
    gain = idm(22.0, 90.0, 24.0) - idm(22.0, 35.0, 18.0)
    passing = appraised(mobil(), True, slower, ROOM, None, None)
    barred = appraised(mobil(european_rule=1.0), True, slower, ROOM, None, None)
    assert float(passing.incentive_mps2[0]) == pytest.approx(gain, abs=2e-4)
    assert float(barred.incentive_mps2[0]) == pytest.approx(0.0, abs=1e-6)
    # and a driver in the free right lane, who must not pass that leader, loses nothing by going behind him
    joining = appraised(mobil(), False, ROOM, slower, None, None)
    behind = appraised(mobil(european_rule=1.0), False, ROOM, slower, None, None)
    assert float(joining.incentive_mps2[0]) == pytest.approx(-gain, abs=2e-4)
    assert float(behind.incentive_mps2[0]) == pytest.approx(0.0, abs=1e-6)


def test_the_incentive_has_a_finite_gradient_where_neighbours_are_missing() -> None:
    def incentive(model: Mobil) -> jax.Array:
        return jnp.sum(appraised(model, True, None, SLOW, None, OLD).excess_mps2)

    gradient = jax.grad(incentive)(mobil(politeness=0.4, european_rule=0.3))
    assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(gradient))
    assert float(gradient.changing_threshold_mps2) == -1.0
    assert abs(float(gradient.politeness)) > 1e-3


NUM_DECISIONS = 150


def with_lane_change(world: World, models: tuple[LaneChangeModel | None, ...]) -> World:
    """Return the world with other lane-change models where they are given."""
    for index, model in enumerate(models):
        if model is not None:
            world = eqx.tree_at(lambda w, i=index: w.classes[i].lane_change, world, model)
    return world


@pytest.fixture(scope="module")
def mixed_world(corridor_world: Callable[..., World]) -> World:
    """Return the corridor with MOBIL for all but the subject vehicle, who keeps LC2013."""
    return with_lane_change(
        corridor_world(19, 42.0, main=3300.0, on1=620.0),
        (mobil(politeness=0.2, changing_threshold_mps2=0.15, keep_right_bias_mps2=0.1), None),
    )


@pytest.fixture(scope="module")
def states(mixed_world: World, drive_on: Callable[[World, int], list[TrafficState]]) -> list[TrafficState]:
    return drive_on(mixed_world, NUM_DECISIONS)


def test_mobil_drivers_change_lane_for_speed_the_right_and_their_route(states: list[TrafficState]) -> None:
    num_changes = np.asarray(states[-1].num_lane_changes)
    assert num_changes[Reason.SPEED_GAIN] > 50
    assert num_changes[Reason.KEEP_RIGHT] > 5
    assert num_changes[Reason.STRATEGIC] > 10
    changed = 0
    for before, after in pairwise(states):
        old = {int(i): e for e, i in enumerate(before.vehicles.identity) if before.vehicles.vehicle_class[e] == 0}
        new = {int(i): e for e, i in enumerate(after.vehicles.identity) if after.vehicles.vehicle_class[e] == 0}
        changed += sum(before.vehicles.row[old[i]] != after.vehicles.row[new[i]] for i in old.keys() & new.keys())
    assert changed > 100


def test_each_class_decides_by_its_own_model(
    states: list[TrafficState], mixed_world: World, corridor_world: Callable[..., World]
) -> None:
    lc2013 = corridor_world(19, 42.0, main=3300.0, on1=620.0)
    reluctant = mobil(changing_threshold_mps2=50.0)
    worlds = (lc2013, mixed_world, with_lane_change(lc2013, (reluctant, None)))
    found = jit_marked(lambda s, w: decide(VehiclesOnRoad(s.vehicles, w.road, s.head), w.classes, 1.0, STEP_S))
    num_different, num_free = 0, 0
    for state in states[60:150:10]:
        ours, mixed, strategic = (found(state, world) for world in worlds)
        is_subject = np.asarray(state.vehicles.vehicle_class == 1)
        for name in ("direction", "gain_left_memory", "keep_right_memory"):
            np.testing.assert_array_equal(
                np.asarray(getattr(mixed, name))[is_subject], np.asarray(getattr(ours, name))[is_subject]
            )
        num_different += int((mixed.direction != ours.direction).sum())
        moves = np.asarray((strategic.direction != 0) & (state.vehicles.vehicle_class == 0))
        assert (np.asarray(strategic.reason)[moves] == Reason.STRATEGIC).all()
        num_free += int(((mixed.direction != 0) & (mixed.reason != Reason.STRATEGIC)).sum())
    assert num_different > 0
    assert num_free > 0


def test_an_unknown_lane_change_model_is_refused(corridor_world: Callable[..., World]) -> None:
    class Other(LaneChangeModel):
        strategic: jax.Array

        def route_parameters(self) -> Lc2013:
            raise NotImplementedError

    world = corridor_world(19, 42.0)
    assert isinstance(world.classes[0].lane_change, Lc2013)
    state = jax.eval_shape(lambda w: initial_state(w, 40), world)
    with pytest.raises(TypeError, match=r"lc2013, mobil, vissim.* got Other"):
        jax.eval_shape(
            lambda s, w: decide(VehiclesOnRoad(s.vehicles, w.road, s.head), w.classes, 1.0, STEP_S),
            state,
            with_lane_change(world, (Other(jnp.ones(())), None)),
        )
