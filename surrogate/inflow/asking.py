"""Who waits at the front of each queue, and who of them may ask for a lane."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.inflow.inflow import ENTRANCE_STRIDE, Inflow, Queues, SubjectPlan, subject_identity
from surrogate.inflow.newcomers import NOBODY_WAITS, Entrants
from surrogate.road.traffic_state import TrafficState

WAITING_SLOTS = 16  # of those who wait for the same lanes, so many may be overtaken by who wants another


class Asking(NamedTuple):
    """Those at the front of each queue who may ask for a lane, by how long they have waited."""

    is_there: Bool[Array, "entrance asking"]  # whether there is one
    is_subject: Bool[Array, "entrance asking"]  # whether it is the subject vehicle
    # its place in the list of those who wait; behind its end for the subject vehicle
    slot: Int[Array, "entrance asking"]
    identity: Int[Array, "entrance asking"]  # who it is
    flow: Int[Array, "entrance asking"]  # flow that it is of
    since_s: Float[Array, "entrance asking"]  # since when it has waited


def who_asks(
    state: TrafficState,
    queues: Queues,
    inflow: Inflow,
    subject: SubjectPlan,
    now_s: Float[Array, ""],
    subject_first: bool,
) -> tuple[Int[Array, "entrance slot"], Asking]:
    """Return the list of those who wait at the front of each queue, and with the subject vehicle who may ask."""
    table, waiting = inflow.timetable, state.waiting
    assert table is not None
    assert waiting is not None
    num_entrances, num_slots = waiting.shape
    num_waiting = jnp.sum(waiting != NOBODY_WAITS, axis=1, dtype=jnp.int32)
    slot = jnp.arange(num_slots, dtype=jnp.int32)
    next_arrival = (state.num_inserted + num_waiting)[:, None] + slot - num_waiting[:, None]
    comes = (slot >= num_waiting[:, None]) & (next_arrival < queues.num_arrived[:, None])
    waiting = jnp.where(comes, next_arrival, waiting)
    num_taken = state.num_inserted + jnp.sum(waiting != NOBODY_WAITS, axis=1, dtype=jnp.int32)

    waits, which = subject.waiting(state.subject_inserted, now_s)
    depart_s = subject.depart_s[which] if subject.num_subjects else subject.depart_s
    if not subject_first:
        waits &= table.num_until(subject.entrance, depart_s) <= num_taken[subject.entrance]
    is_own_queue = jnp.arange(num_entrances, dtype=jnp.int32) == subject.entrance

    arrival = jnp.clip(waiting, 0, table.time_s.shape[1] - 1)
    place = jnp.take_along_axis(table.place, arrival, axis=1)
    entrance = jnp.arange(num_entrances, dtype=jnp.int32)[:, None]
    own_identity = jnp.broadcast_to(subject_identity(num_entrances) + which, (num_entrances, 1))

    def with_subject(others: Array, own: Array) -> Array:
        return jnp.concatenate([others, jnp.broadcast_to(own, (num_entrances, 1)).astype(others.dtype)], axis=1)

    is_there = with_subject(waiting != NOBODY_WAITS, (is_own_queue & waits)[:, None])
    since_s = with_subject(
        jnp.take_along_axis(table.time_s, arrival, axis=1), jnp.asarray(-jnp.inf) if subject_first else depart_s
    )
    asking = Asking(
        is_there=is_there,
        is_subject=with_subject(jnp.zeros(waiting.shape, bool), is_own_queue[:, None]),
        slot=with_subject(jnp.broadcast_to(slot, waiting.shape), jnp.asarray(num_slots)),
        identity=with_subject(entrance * ENTRANCE_STRIDE + place, own_identity),
        flow=with_subject(jnp.take_along_axis(table.flow, place, axis=1), jnp.asarray(0)),
        since_s=since_s,
    )
    in_turn = jnp.argsort(jnp.where(is_there, since_s, jnp.inf), axis=1, stable=True)
    return waiting, Asking(*(jnp.take_along_axis(values, in_turn, axis=1) for values in asking))


def still_waiting(
    candidates: Entrants, has_entered: Bool[Array, "candidate one"]
) -> Int[Array, "entrance slot"] | None:
    """Return who waits after some have entered; None where queues need no list."""
    if candidates.waiting is None or candidates.slot is None:
        return None
    waiting, slot = candidates.waiting, candidates.slot
    slots = jnp.arange(waiting.shape[1])
    left = (slot[..., None] == slots) & has_entered.reshape(slot.shape)[..., None]
    waiting = jnp.where(jnp.any(left, axis=1), NOBODY_WAITS, waiting)
    in_front = jnp.argsort(waiting == NOBODY_WAITS, axis=1, stable=True)
    return jnp.take_along_axis(waiting, in_front, axis=1)
