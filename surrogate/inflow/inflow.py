"""Where and as what vehicles enter, and how they arrive: at random, in a queue before a full entrance.

Arrivals are a Poisson process in *demand*: the k-th vehicle of an entrance arrives when its cumulated demand reaches
the sum of k exponential numbers. So a change of the demand moves arrivals in time but never exchanges the vehicles:
arrival k keeps its destination and its driver under every parameter set.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import true_arrival
from surrogate.effects.base import Arrivals
from surrogate.effects.settings import Effects
from surrogate.inflow.departure import DepartureRules
from surrogate.inflow.timetable import Timetable
from surrogate.keyed_random import Purpose, exponential
from surrogate.road.traffic_state import TrafficState
from surrogate.xla.gather import take

ARRIVALS_PER_DECISION = 4  # at most this many join a queue per decision; the rest come at the next one
ARRIVALS_BY_TIMETABLE = 8  # the same where flows may all begin at once
ENTRANCE_STRIDE = 1 << 20  # identity = entrance * stride + arrival number


def subject_identity(num_entrances: int) -> int:
    """Return what keys the first subject vehicle's random numbers; those of further ones follow."""
    return num_entrances * ENTRANCE_STRIDE


class Inflow(eqx.Module):
    """Where and as what vehicles enter."""

    lane_row: Int[Array, "entrance lane"]  # rows of each entrance's lanes, from the right; -1 beyond the last
    start_m: Float[Array, " entrance"]  # where the entrance's first edge begins
    end_m: Float[Array, " entrance"]  # where it ends; newcomers are placed on it
    # whether a lane of the entrance is among the best for a destination (SUMO's departLane="best")
    serves: Bool[Array, "entrance destination lane"]
    is_regular: Bool[Array, " entrance"]  # whether vehicles arrive evenly instead of at random
    flow_share: Float[Array, "entrance flow"]  # cumulated shares of the flows of each entrance; 1 from the last flow on
    flow_destination: Int[Array, "entrance flow"]  # destination of each flow
    flow_class: Int[Array, "entrance flow"]  # vehicle class of each flow
    begin_s: Float[Array, " entrance"]  # when the entrance opens
    end_s: Float[Array, " entrance"]  # when it closes
    # every arrival, where entrances have flows of several windows of time, or single vehicles; None where one
    # window each says it all. Vehicles that wait for different lanes do not wait for one another, so an edge then
    # is as many entrances as there are sets of lanes among those who enter there.
    timetable: Timetable | None = None
    # how vehicles depart; given with a timetable, None where all do as `entering` has it
    rules: DepartureRules | None = None

    @property
    def num_entrances(self) -> int:
        """Number of entrances."""
        return self.start_m.shape[0]


class SubjectPlan(eqx.Module):
    """When and where the subject vehicle enters."""

    # when it enters, or as soon after as there is room. Several subject vehicles have a time each, in order.
    depart_s: Float[Array, "*subject"]
    entrance: int = eqx.field(static=True)  # index of its entrance
    destination: int = eqx.field(static=True)  # index of its destination
    vehicle_class: int = eqx.field(static=True)  # its class; a number of the trace, not a leaf

    @property
    def num_subjects(self) -> int:
        """How many subject vehicles there are; 0 where there is one, of which arrays then have no axis."""
        return self.depart_s.shape[0] if self.depart_s.ndim else 0

    def waiting(self, inserted: Bool[Array, "*subject"], now_s: Float[Array, ""]) -> tuple[Array, Array | int]:
        """Return whether one waits to enter, and which.

        Args:
            inserted: which are on the road, or were.
            now_s: time.
        """
        waits = ~inserted & (now_s >= self.depart_s)
        if not self.num_subjects:
            return waits, 0
        return jnp.any(waits), jnp.argmax(waits).astype(jnp.int32)


class Queues(eqx.Module):
    """The queues after the arrivals of one decision."""

    num_arrived: Int[Array, " entrance"]
    next_arrival: Float[Array, " entrance"]
    cumulated_demand: Float[Array, " entrance"]


def arrive(
    state: TrafficState,
    inflow: Inflow,
    demand_vehps: Float[Array, " entrance"],
    seed: Int[Array, ""],
    now_s: Float[Array, ""],
    interval_s: float,
    effects: Effects | None = None,
    mainline: int = 0,
) -> Queues:
    """Return the queues after `interval_s` more of demand.

    Args:
        state: the road before.
        inflow: where vehicles enter.
        demand_vehps: demand of each entrance.
        seed: seed of the run.
        now_s: time.
        interval_s: time since the last call.
        effects: what the baseline lacks; None for the baseline.
        mainline: entrance of the subject vehicle.
    """
    if inflow.timetable is not None:
        return _arrive_by_timetable(state, inflow.timetable, now_s)
    draws = ArrivalDraws(inflow, demand_vehps, seed, effects, mainline)
    is_open = (now_s > inflow.begin_s) & (now_s <= inflow.end_s)
    demand = state.cumulated_demand + jnp.where(is_open, demand_vehps * interval_s, 0.0)
    num_arrived, threshold = state.num_arrived, state.next_arrival
    for _ in range(ARRIVALS_PER_DECISION):
        has_come = demand >= threshold
        num_arrived = num_arrived + has_come
        threshold = threshold + jnp.where(has_come, draws.demand_to(num_arrived), 0.0)
    return Queues(num_arrived, threshold, demand)


def _arrive_by_timetable(state: TrafficState, table: Timetable, now_s: Float[Array, ""]) -> Queues:
    num_arrived = state.num_arrived
    entrance = jnp.arange(num_arrived.shape[0], dtype=jnp.int32)
    last = table.time_s.shape[1] - 1  # nobody ever arrives there
    for _ in range(ARRIVALS_BY_TIMETABLE):
        next_s = take(table.time_s.reshape(-1), entrance * (last + 1) + jnp.minimum(num_arrived, last))
        num_arrived = num_arrived + (next_s <= now_s)
    return Queues(num_arrived, state.next_arrival, state.cumulated_demand)


class ArrivalDraws(eqx.Module):
    """How far apart vehicles arrive."""

    inflow: Inflow  # where vehicles enter
    demand_vehps: Float[Array, " entrance"]  # demand of each entrance
    seed: Int[Array, ""]  # seed of the run
    effects: Effects | None  # what the baseline lacks; None for the baseline
    mainline: int = eqx.field(static=True)  # entrance of the subject vehicle

    def demand_to(self, arrival: Int[Array, " entrance"]) -> Float[Array, " entrance"]:
        """Return the demand [veh] between arrival number `arrival` - 1 and `arrival`."""
        entrance = jnp.arange(self.inflow.num_entrances, dtype=jnp.int32)
        gap = exponential(self.seed, entrance * ENTRANCE_STRIDE + arrival, 0, Purpose.ARRIVAL)
        if self.effects is not None:
            num_lanes = jnp.sum(self.inflow.lane_row >= 0, axis=1, dtype=jnp.int32)
            is_mainline = entrance == self.mainline
            gap = true_arrival(
                self.effects, gap, Arrivals(arrival, num_lanes, self.demand_vehps, is_mainline, self.seed)
            )
        return jnp.where(self.inflow.is_regular, 1.0, gap)
