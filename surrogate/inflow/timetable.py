"""Who arrives when, where entrances know more than one window of time: every arrival of a run in a table.

A flow has a window and a rate of its own: its k-th vehicle comes when its cumulated demand reaches k, or the sum of k
exponential numbers. A single vehicle comes at its second; where demand is scaled, it is left out or comes twice, evenly
(`sim_adapters/scenario/scaled_demand.py` does the same for SUMO). So a change of the demand moves arrivals in time, but
never exchanges the vehicles: each place of the table keeps its driver under every parameter set.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import true_arrival
from surrogate.effects.base import Arrivals
from surrogate.effects.settings import Effects
from surrogate.keyed_random import Purpose, exponential, uniform

FLOW_STRIDE = 1 << 20  # of keys of random numbers: flow * stride + number of the vehicle
SMALLEST_RATE_VEHPS = 1e-9
NEVER_S = jnp.inf


class Schedule(eqx.Module):
    """What may arrive; the same for all runs of a scenario."""

    begin_s: Float[Array, " flow"]  # when each flow begins
    end_s: Float[Array, " flow"]  # when it ends
    opens_s: Float[Array, ""]  # before this nobody comes, whatever a flow says
    is_regular: Bool[Array, " flow"]  # whether its vehicles come evenly instead of at random
    # whether a regular flow's first vehicle comes anywhere within the first interval, as where it is one part of
    # a flow; else at its begin
    begins_anywhere: Bool[Array, " flow"]
    queue: Int[Array, " flow"]  # queue of each flow
    column: Int[Array, " flow"]  # number of the flow in its queue, for its rate
    is_mainline: Bool[Array, " flow"]  # whether the subject vehicle enters at the same edge
    num_lanes: Int[Array, " flow"]  # lanes of that edge
    vehicle_s: Float[Array, " single"]  # when each single vehicle departs
    vehicle_number: Int[Array, " single"]  # its number among those that are scaled together
    vehicle_column: Int[Array, "single two"]  # queue and column of its kind, for the factor
    # for each place of each queue's table, where its arrival stands: flow by flow, then vehicle by vehicle, each
    # as often as it may come, then one that never comes
    source: Int[Array, "queue place"]
    flow: Int[Array, "queue place"]  # column of each place's flow in its queue
    most_of_flow: int = eqx.field(static=True)  # vehicles of a flow for which there is room
    most_copies: int = eqx.field(static=True)  # how often a single vehicle may come


class Timetable(eqx.Module):
    """The arrivals of one run, in order."""

    time_s: Float[Array, "queue arrival"]  # when the vehicles of each queue arrive, rising; inf behind the last
    place: Int[Array, "queue arrival"]  # place of each in the schedule, which keys its random numbers
    flow: Int[Array, "queue place"]  # column of each place's flow in its queue

    def num_until(self, queue: int, time_s: Float[Array, ""]) -> Int[Array, ""]:
        """Return how many have arrived at a queue before a time."""
        return jnp.sum(self.time_s[queue] < time_s, dtype=jnp.int32)


def timetable(
    schedule: Schedule,
    rate_vehps: Float[Array, "queue flow"],
    factor: Float[Array, "queue flow"],
    seed: Int[Array, ""],
    effects: Effects | None = None,
) -> Timetable:
    """Return the arrivals of a run.

    Args:
        schedule: what may arrive.
        rate_vehps: rate of each flow of each queue while it comes.
        factor: by which single vehicles of each kind are scaled.
        seed: seed of the run.
        effects: what the baseline lacks; None for the baseline.
    """
    times = (
        _times_of_flows(schedule, rate_vehps, seed, effects).reshape(-1),
        _times_of_vehicles(schedule, factor).reshape(-1),
        jnp.full((1,), NEVER_S, jnp.float32),
    )
    time_s = jnp.concatenate(times)[schedule.source]
    time_s = jnp.where(time_s >= schedule.opens_s, time_s, NEVER_S)
    place = jnp.argsort(time_s, axis=1).astype(jnp.int32)
    return Timetable(jnp.take_along_axis(time_s, place, axis=1), place, schedule.flow)


def _times_of_flows(
    schedule: Schedule, rate_vehps: Float[Array, "queue flow"], seed: Int[Array, ""], effects: Effects | None
) -> Float[Array, "flow arrival"]:
    """Return when each flow's vehicles come; inf beyond its end."""
    rate = rate_vehps[schedule.queue, schedule.column]
    flow = jnp.arange(schedule.begin_s.shape[0], dtype=jnp.int32)
    number = jnp.arange(schedule.most_of_flow, dtype=jnp.int32)
    keys = flow[:, None] * FLOW_STRIDE + number
    gap = exponential(seed, keys, 0, Purpose.ARRIVAL)
    if effects is not None:

        def as_it_is(gap: Float[Array, " flow"], number: Int[Array, ""]) -> Float[Array, " flow"]:
            arrival = jnp.broadcast_to(number, gap.shape)
            return true_arrival(effects, gap, Arrivals(arrival, schedule.num_lanes, rate, schedule.is_mainline, seed))

        gap = jax.vmap(as_it_is, in_axes=(1, 0), out_axes=1)(gap, number)
    first = jnp.where(schedule.begins_anywhere, uniform(seed, flow * FLOW_STRIDE, 0, Purpose.ARRIVAL), 0.0)
    even = jnp.where(number == 0, first[:, None], 1.0)
    demand = jnp.cumsum(jnp.where(schedule.is_regular[:, None], even, gap), axis=1)
    time_s = schedule.begin_s[:, None] + demand / jnp.maximum(rate, SMALLEST_RATE_VEHPS)[:, None]
    comes = (time_s < schedule.end_s[:, None]) & (rate > SMALLEST_RATE_VEHPS)[:, None]
    return jnp.where(comes, time_s, NEVER_S)


def _times_of_vehicles(schedule: Schedule, factor: Float[Array, "queue flow"]) -> Float[Array, "single copy"]:
    """Return when single vehicles come, as often as they may; inf for those that do not."""
    own = factor[schedule.vehicle_column[:, 0], schedule.vehicle_column[:, 1]]
    number = schedule.vehicle_number.astype(jnp.float32)
    num_copies = jnp.floor(own * (number + 1.0) + 0.5) - jnp.floor(own * number + 0.5)
    copy = jnp.arange(schedule.most_copies, dtype=jnp.float32)
    return jnp.where(copy < num_copies[:, None], schedule.vehicle_s[:, None], NEVER_S)
