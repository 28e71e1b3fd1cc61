"""A straight road of a few lanes, vehicles on it, and a subject vehicle that drives by its own model in closed loop."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from sim_adapters.sumo.surroundings import Surroundings, vehicle_arrays
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.kinematics import move
from surrogate.loop.step import look_up_lane
from surrogate.road.neighbours import own_leader
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.subject.planner import Plan, Planner, plan
from surrogate.subject.registry import SubjectModel
from surrogate.subject.view import SubjectView, look_around
from surrogate.vehicle.lane_change_model import STAY
from surrogate.vehicle.vehicle_class import VehicleClass
from tests.jit_marked import jit_marked

STEP_S, STEPS_PER_PLAN = 0.1, 10
LIMIT_MPS, LENGTH_M = 21.0, 4.6
CAR, SUBJECT = 0, 1
ATTRIBUTES = {"length": "4.6", "accel": "2.4", "decel": "4.1", "tau": "1.1", "minGap": "2.2", "speedDev": "0"}


def straight_road(num_rows: int, end_of_row_0_m: float = np.inf, length_m: float = 4000.0) -> Road:
    """Return a road without exits; the rightmost lane may end before the others, which all vehicles then must leave."""
    shape = (num_rows, 1)
    ends = np.isfinite(end_of_row_0_m)
    stop = np.full((1, *shape), np.inf)
    stop[0, 0, 0] = end_of_row_0_m
    offset = np.zeros((1, *shape), int)
    offset[0, 0, 0] = int(ends)
    rows = np.arange(num_rows)[:, None]
    as_float, as_int = (lambda dtype: lambda values: jnp.asarray(values, dtype))(jnp.float32), jnp.int32
    return Road(
        cell_origin_m=as_float(0.0),
        cell_length_m=as_float(2.0),
        cell_segment=jnp.zeros((4,), as_int),
        segment_end_m=as_float([np.inf]),
        speed_limit_mps=as_float(np.full(shape, LIMIT_MPS)),
        slow_position_m=as_float(np.full(shape, np.inf)),
        slow_limit_mps=as_float(np.full(shape, LIMIT_MPS)),
        left_row=jnp.asarray(np.where(rows + 1 < num_rows, rows + 1, -1), as_int),
        right_row=jnp.asarray(rows - 1, as_int),
        best_lane_offset=jnp.asarray(offset, as_int),
        continuation_end_m=as_float(np.minimum(stop, length_m)),
        end_position_m=as_float([length_m]),
        track_end=jnp.zeros((1, *shape), as_int),
        stop_position_m=as_float(stop),
        destination_end_m=as_float([length_m]),
        is_carriageway=jnp.ones(shape, bool),
        leads_elsewhere=jnp.zeros(shape, bool),
        edge_start_m=as_float([0.0]),
        edge_length_m=as_float([length_m]),
        num_lanes=as_float([num_rows]),
        borders_per_cell=0,
    )


def classes_of(model: SubjectModel) -> tuple[VehicleClass, ...]:
    """Return IDM cars and the subject vehicle, which is one of them with another driver."""
    car = vehicle_class(attribute_values(ATTRIBUTES, "IDM"), "IDM")
    return car, model.vehicle_class(car)


def laid_out(
    subject: tuple[int, float, float, float], others: Sequence[tuple[int, float, float]], num_rows: int
) -> tuple[VehicleArrays, jax.Array]:
    """Return vehicle arrays and heads.

    Args:
        subject: row, position [m], speed [m/s] and acceleration [m/s^2].
        others: row, position and speed of each other vehicle.
        num_rows: rows of the road.
    """
    table = np.asarray([subject[:3], *others], float)
    around = Surroundings(
        row=table[:, 0].astype(int),
        position_m=table[:, 1],
        speed_mps=table[:, 2],
        acceleration_mps2=np.asarray([subject[3], *[0.0] * len(others)]),
        vehicle_class=np.asarray([SUBJECT, *[CAR] * len(others)]),
        subject=0,
        speed_factor=1.0,
    )
    arrays, head, _ = vehicle_arrays(around, num_rows)
    return jax.tree.map(jnp.asarray, arrays), jnp.asarray(head)


def seen(road: Road, vehicles: VehicleArrays, head: jax.Array, model: SubjectModel) -> SubjectView:
    """Return what the planner sees up to 150 m away."""
    far = jnp.asarray(150.0)
    return look_around(vehicles, head, road, classes_of(model), SUBJECT, far, far)


TRACED: list[SubjectView] = []  # each view with which planning was traced


@jit_marked
def _plan(planner: Planner, view: SubjectView) -> Plan:
    TRACED.append(view)
    return plan(planner, view, STEP_S * STEPS_PER_PLAN)


def planned(
    subject: tuple[int, float, float, float],
    others: Sequence[tuple[int, float, float]],
    num_rows: int = 2,
    end_of_row_0_m: float = np.inf,
    **parameters: float,
) -> Plan:
    """Return the plan in a situation."""
    model = SubjectModel("planner", parameters)
    vehicles, head = laid_out(subject, others, num_rows)
    planner = model.planner(150.0, 150.0)
    assert planner is not None
    return _plan(planner, seen(straight_road(num_rows, end_of_row_0_m), vehicles, head, model))


@eqx.filter_jit
def _follow(
    vehicles: VehicleArrays,
    head: jax.Array,
    road: Road,
    classes: tuple[VehicleClass, ...],
    planner: Planner | None,
    leader_mps: jax.Array,
) -> dict[str, jax.Array]:
    """Return gap, speed and acceleration of the subject vehicle behind a leader with the given speeds, each step."""
    leader = jnp.argmax(vehicles.vehicle_class == CAR)
    subject = jnp.argmax(vehicles.vehicle_class == SUBJECT)
    vehicles = look_up_lane(vehicles, VehiclesOnRoad(vehicles, road, head))
    one = jnp.ones_like(vehicles.speed_mps)

    def advance(carry: tuple[VehicleArrays, jax.Array], u: jax.Array) -> tuple:
        now, step = carry
        if planner is not None:
            far = jnp.asarray(150.0)
            view = look_around(now, head, road, classes, SUBJECT, far, far)
            wanted = plan(planner, view, STEP_S * STEPS_PER_PLAN).acceleration_mps2
            held = jnp.where(step % STEPS_PER_PLAN == 0, wanted, now.own_advice_mps2[subject])
            now = with_changes(now, own_advice_mps2=now.own_advice_mps2.at[subject].set(held))
        moved, _ = move(now, own_leader(now), classes, one, step, step, STEP_S)
        braking = (u - now.speed_mps[leader]) / STEP_S
        moved = with_changes(
            moved,
            speed_mps=moved.speed_mps.at[leader].set(u),
            position_m=moved.position_m.at[leader].set(now.position_m[leader] + STEP_S * u),
            acceleration_mps2=moved.acceleration_mps2.at[leader].set(braking),
        )
        told = {
            "gap_m": moved.position_m[leader] - LENGTH_M - moved.position_m[subject],
            "speed_mps": moved.speed_mps[subject],
            "acceleration_mps2": moved.acceleration_mps2[subject],
        }
        return (moved, step + 1), told

    return jax.lax.scan(advance, (vehicles, jnp.zeros((), jnp.int32)), leader_mps)[1]


def followed(
    model: SubjectModel, gap_m: float, speed_mps: float, leader_mps: np.ndarray, num_rows: int = 1
) -> dict[str, np.ndarray]:
    """Return how the subject vehicle follows a leader in a single lane.

    Args:
        model: who drives it.
        gap_m: gap at the beginning; inf for a free road.
        speed_mps: its speed at the beginning.
        leader_mps: the leader's speed after each step.
        num_rows: lanes of the road.
    """
    here_m = 500.0
    far_m = 1e5 if np.isinf(gap_m) else here_m + gap_m + LENGTH_M
    vehicles, head = laid_out((0, here_m, speed_mps, 0.0), [(0, far_m, float(leader_mps[0]))], num_rows)
    told = _follow(
        vehicles, head, straight_road(num_rows), classes_of(model), model.planner(150.0, 150.0), jnp.asarray(leader_mps)
    )
    return {name: np.asarray(values) for name, values in told.items()}


def merged(
    subject: tuple[int, float, float, float], others: Sequence[tuple[int, float, float]], end_m: float, seconds: int
) -> list[int]:
    """Return the row of the subject vehicle after each second, on a road of two lanes whose right one ends."""
    model = SubjectModel("planner")
    planner, classes, road = model.planner(150.0, 150.0), classes_of(model), straight_road(2, end_m)
    assert planner is not None
    now, places = subject, list(others)
    rows = []
    for _ in range(seconds):
        vehicles, head = laid_out(now, places, 2)
        chosen = _plan(planner, seen(road, vehicles, head, model))
        row = now[0] + (int(chosen.direction) if int(chosen.direction) != STAY else 0)
        vehicles, head = laid_out((row, *now[1:]), places, 2)
        now, places = _second(vehicles, head, road, classes, chosen.acceleration_mps2)
        rows.append(now[0])
    return rows


def _second(
    vehicles: VehicleArrays, head: jax.Array, road: Road, classes: tuple[VehicleClass, ...], held: jax.Array
) -> tuple[tuple[int, float, float, float], list[tuple[int, float, float]]]:
    vehicles = _move_on(vehicles, head, road, classes, held)
    kind = np.asarray(vehicles.vehicle_class)
    assert np.all(_gaps(vehicles) > 0.0)
    rows, positions, speeds = (np.asarray(a).tolist() for a in (vehicles.row, vehicles.position_m, vehicles.speed_mps))
    (s,) = np.flatnonzero(kind == SUBJECT)
    others = [(rows[i], positions[i], speeds[i]) for i in np.flatnonzero(kind == CAR)]
    return (rows[s], positions[s], speeds[s], float(vehicles.acceleration_mps2[s])), others


@jit_marked
def _move_on(
    vehicles: VehicleArrays, head: jax.Array, road: Road, classes: tuple[VehicleClass, ...], held: jax.Array
) -> VehicleArrays:
    vehicles = look_up_lane(vehicles, VehiclesOnRoad(vehicles, road, head))
    is_subject = vehicles.vehicle_class == SUBJECT
    vehicles = with_changes(vehicles, own_advice_mps2=jnp.where(is_subject, held, jnp.inf))
    one = jnp.ones_like(vehicles.speed_mps)

    def step(number: jax.Array, now: VehicleArrays) -> VehicleArrays:
        return move(now, own_leader(now), classes, one, number, number, STEP_S)[0]

    return jax.lax.fori_loop(0, STEPS_PER_PLAN, step, vehicles)


def _gaps(vehicles: VehicleArrays) -> np.ndarray:
    row, position, kind = (np.asarray(a) for a in (vehicles.row, vehicles.position_m, vehicles.vehicle_class))
    pair = (kind[:-1] >= 0) & (kind[1:] >= 0) & (row[:-1] == row[1:])
    place = np.where(np.isfinite(position), position, 0.0)
    return np.where(pair, place[:-1] - LENGTH_M - place[1:], np.inf)
