"""What all diagnostic features have in common: the road, what is seen of it, and the drivers expected there."""

import functools
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.units import kmh_from_mps, mps_from_kmh
from surrogate.road.drive_table import LogFormat
from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.vehicle_class import VehicleClass

STRETCH_M = 200.0
PERIOD_S = 60.0
PADDING = 8192  # rows are filled up to multiples of it, so that few array shapes are compiled
FREE_GAP_M = 1e6
ROUNDING_STEPS = (1.0, 0.5, 0.1, 0.05, 0.01, 0.001)  # of distances in m and speeds in km/h
ROUNDING_TOLERANCE = 0.02  # of a step
NEARLY_ALL_ROUNDED = 0.9  # rows that came late are moved to the subject vehicle's instants


@dataclass(frozen=True)
class Conventions:
    """What features have in common."""

    step_s: float  # time step of the simulation
    nominal_length_m: float  # length taken for every vehicle
    stretch_m: np.ndarray  # borders of the stretches of route
    period_s: np.ndarray  # borders of the periods of time
    lane_from_left: np.ndarray  # for each row of the road its lane counted from the left, 1 is the leftmost
    segment_end_m: np.ndarray  # ends of the road's segments
    limit_mps: np.ndarray  # speed limit, [row, segment]
    merge_m: np.ndarray  # where vehicles may enter from a ramp, [merge, (begin, end)]
    log: LogFormat  # range and rounding of the logs

    def limit_at(self, lane: Int[np.ndarray, " row"], position_m: Float[np.ndarray, " row"]) -> np.ndarray:
        """Speed limit at positions of lanes."""
        segment = np.searchsorted(self.segment_end_m, position_m, side="right")
        return self.limit_mps[lane, np.minimum(segment, self.limit_mps.shape[1] - 1)]


def conventions_of(problem: CalibrationProblem) -> Conventions:
    """Return the conventions for a problem."""
    network, road = problem.scenario.network, problem.template.road
    order = np.asarray(problem.road.lateral_order)
    length_m = network.length_m
    stretches = max(4, round(length_m / STRETCH_M))
    begin_s = min(drive.depart_s for drive in problem.case.drives)
    end_s = problem.parts.scenario.duration_s
    most = max(network.lane_count[edge] for edge in network.main_edges)
    usual = np.median([network.lane_count[edge] for edge in network.main_edges])
    wide = [edge for edge in network.main_edges if network.lane_count[edge] > usual] if most > usual else []
    return Conventions(
        step_s=problem.parts.scenario.step_s,
        nominal_length_m=problem.case.perception.nominal_length_m,
        stretch_m=np.linspace(0.0, length_m, stretches + 1),
        period_s=np.arange(begin_s, end_s + PERIOD_S, PERIOD_S),
        lane_from_left=np.round(order.max() - order).astype(int) + 1,
        segment_end_m=np.asarray(road.segment_end_m, float),
        limit_mps=np.asarray(road.speed_limit_mps, float),
        merge_m=np.asarray([(network.edge_start_m(e), network.edge_end_m(e)) for e in wide]).reshape(-1, 2),
        log=LogFormat(
            ahead_m=problem.case.perception.ahead_m,
            behind_m=problem.case.perception.behind_m,
            place_step_m=rounding_step(np.concatenate([drive.objects.offset_m for drive in problem.drives])),
            speed_step_mps=mps_from_kmh(
                rounding_step(kmh_from_mps(1.0) * np.concatenate([drive.objects.speed_mps for drive in problem.drives]))
            ),
        ),
    )


def rounding_step(values: np.ndarray) -> float:
    """Rounding of values: the coarsest step that nearly all of them are multiples of."""
    for step in ROUNDING_STEPS:
        off = np.abs(values - np.round(values / step) * step)
        if len(values) and np.mean(off < ROUNDING_TOLERANCE * step) > NEARLY_ALL_ROUNDED:
            return step
    return ROUNDING_STEPS[-1]


@dataclass(frozen=True)
class ExpectedDrivers:
    """How vehicles of a class accelerate where nothing but car-following moves them."""

    vehicle: VehicleClass  # the class, with the calibrated parameters
    step_s: float  # time step of the simulation

    @property
    def speed_factor(self) -> float:
        """Mean of desired speed over limit."""
        return float(self.vehicle.speed_factor_mean)

    def acceleration(
        self, speed_mps: np.ndarray, gap_m: np.ndarray, leader_speed_mps: np.ndarray, desired_speed_mps: np.ndarray
    ) -> np.ndarray:
        """Return the expected acceleration of each row; gaps may be inf."""
        size = len(speed_mps)
        padded = -size % PADDING

        def fill(values: np.ndarray, value: float) -> np.ndarray:
            return np.concatenate([values, np.full(padded, value)]).astype(np.float32)

        answer = _acceleration(
            self.vehicle.car_following,
            fill(speed_mps, 10.0),
            fill(np.clip(gap_m, 0.1, FREE_GAP_M), 100.0),
            fill(leader_speed_mps, 10.0),
            fill(np.minimum(desired_speed_mps, float(self.vehicle.max_speed_mps)), 20.0),
            self.step_s,
        )
        return np.asarray(answer, np.float64)[:size]


@functools.partial(jax.jit, static_argnums=5)
def _acceleration(
    model: CarFollowingModel, speed: jax.Array, gap: jax.Array, leader: jax.Array, desired: jax.Array, step_s: float
) -> jax.Array:
    zero = jnp.zeros_like(speed)
    wanted = model.acceleration(
        FollowingSituation(speed, gap, leader, zero, zero, desired, jnp.full_like(speed, 0.5)), step_s
    )
    least = -jnp.minimum(model.emergency_deceleration_mps2, speed / step_s)
    return jnp.clip(wanted, least, model.max_acceleration_mps2)


def expected_drivers(problem: CalibrationProblem, values: np.ndarray) -> tuple[ExpectedDrivers, ExpectedDrivers]:
    """Return the background drivers and the subject vehicle's under parameter values.

    Logs do not say who is of which vType: background drivers are those of the first.
    """
    world = problem.template.world(jnp.asarray(values, jnp.float32), jnp.asarray(0), jnp.asarray(0.0))
    names = problem.template.class_names
    background = names.index(problem.layout.vtype_groups[0][0])
    step_s = problem.parts.scenario.step_s
    return ExpectedDrivers(world.classes[background], step_s), ExpectedDrivers(world.classes[-1], step_s)
