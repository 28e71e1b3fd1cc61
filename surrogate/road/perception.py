"""What the subject vehicle detects at one instant. Every source of observations, simulated or real, ends up here."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.road.neighbours import entry_ahead
from surrogate.road.road import Road
from surrogate.road.traffic_state import UNSEEN, TrafficState
from surrogate.xla.gather import take

NO_TRACK = -1


class PerceptionFrame(eqx.Module):
    """The subject vehicle and the vehicles around it at one instant.

    Objects are sorted by (row, -position), so that the leader of an object in its lane is the object before it if both
    are in the same row. The subject vehicle is one of them. Rows are continuous along the road: where an auxiliary lane
    begins on the right the lane numbers change but the rows do not, so a change of row is a change of lane.
    """

    time_s: Float[Array, ""]  # time on the scenario's clock
    # whether the subject vehicle drives at this instant; everything else is meaningless where it does not
    valid: Bool[Array, ""]
    subject_position_m: Float[Array, ""]  # its front bumper along the route
    subject_speed_mps: Float[Array, ""]
    subject_acceleration_mps2: Float[Array, ""]
    num_lanes: Float[Array, ""]  # lanes of the carriageway where it is
    object_valid: Bool[Array, " object"]  # whether there is an object at this place of the arrays
    object_is_subject: Bool[Array, " object"]  # whether that object is the subject vehicle
    # number of the object, stable while it is tracked; that of the subject vehicle is NO_TRACK
    object_track: Int[Array, " object"]
    object_row: Int[Array, " object"]
    object_offset_m: Float[Array, " object"]  # its front bumper less that of the subject vehicle, along the road
    object_speed_mps: Float[Array, " object"]
    object_lateral_m: Float[Array, " object"]  # its offset from the centre of its lane, + left; nan where unknown
    ahead_m: Float[Array, ""]  # range of the sensors ahead
    behind_m: Float[Array, ""]  # range of the sensors behind


class Sensor(eqx.Module):
    """The subject vehicle's sensors."""

    ahead_m: Float[Array, ""]  # range ahead, front bumper to front bumper
    behind_m: Float[Array, ""]  # range behind
    objects_per_row: int = eqx.field(static=True)  # places for objects in each row; more are not seen


def blank_frame(road: Road, sensor: Sensor) -> PerceptionFrame:
    """Return a frame that is not valid, of the shape that `perceive` makes."""
    num_objects = road.num_rows * sensor.objects_per_row
    zero, nothing = jnp.zeros((), jnp.float32), jnp.zeros((num_objects,), jnp.float32)
    no_object = jnp.zeros((num_objects,), bool)
    return PerceptionFrame(
        time_s=zero,
        valid=jnp.zeros((), bool),
        subject_position_m=zero,
        subject_speed_mps=zero,
        subject_acceleration_mps2=zero,
        num_lanes=zero,
        object_valid=no_object,
        object_is_subject=no_object,
        object_track=jnp.full((num_objects,), NO_TRACK, jnp.int32),
        object_row=jnp.zeros((num_objects,), jnp.int32),
        object_offset_m=nothing,
        object_speed_mps=nothing,
        object_lateral_m=nothing,
        ahead_m=zero,
        behind_m=zero,
    )


def is_other(frame: PerceptionFrame) -> Bool[Array, " object"]:
    """Which objects are vehicles other than the subject vehicle."""
    return frame.object_valid & ~frame.object_is_subject


def frame_number(frame: PerceptionFrame) -> Int[Array, ""]:
    """Return a number that keys the random numbers of a frame: its time in milliseconds."""
    return jnp.round(frame.time_s * 1000.0).astype(jnp.int32)


def with_objects(frame: PerceptionFrame, valid: Bool[Array, " object"]) -> PerceptionFrame:
    """Return the frame with only these of its objects."""
    return dataclasses.replace(
        frame,
        object_valid=valid,
        object_track=jnp.where(valid, frame.object_track, NO_TRACK),
        object_offset_m=jnp.where(valid, frame.object_offset_m, 0.0),
        object_speed_mps=jnp.where(valid, frame.object_speed_mps, 0.0),
    )


def in_order(frame: PerceptionFrame) -> PerceptionFrame:
    """Return the frame with its objects sorted by (row, -position); places without an object come last."""
    row = jnp.where(frame.object_valid, frame.object_row, jnp.iinfo(jnp.int32).max)
    entries = jnp.arange(row.shape[0], dtype=jnp.int32)
    *_, order = jax.lax.sort((row, -frame.object_offset_m, entries), num_keys=2)
    names = [name for name in PerceptionFrame.__dataclass_fields__ if name.startswith("object_")]
    return dataclasses.replace(frame, **{name: take(getattr(frame, name), order) for name in names})


def perceive(
    state: TrafficState,
    road: Road,
    sensor: Sensor,
    subject_class: int,
    time_s: Float[Array, ""],
    identity: Int[Array, ""] | None = None,
) -> tuple[TrafficState, PerceptionFrame, Int[Array, " object"]]:
    """What the subject vehicle detects, the state with newly detected vehicles numbered, and objects' entries.

    Only the carriageway is seen; vehicles on ramps are not.

    Args:
        state: the road.
        road: its geometry.
        sensor: the subject vehicle's sensors.
        subject_class: its class.
        time_s: time.
        identity: which vehicle of that class it is; needed only where there are several.
    """
    vehicles = state.vehicles
    end_m = take(road.destination_end_m, vehicles.destination)
    has_arrived = vehicles.position_m >= end_m  # it leaves the road at the next decision
    is_subject = (vehicles.vehicle_class == subject_class) & ~has_arrived
    if identity is not None:
        is_subject &= vehicles.identity == identity
    valid = jnp.any(is_subject)
    subject = jnp.argmax(is_subject)
    here_m, speed = take(vehicles.position_m, subject), take(vehicles.speed_mps, subject)
    here_m = jnp.where(valid, here_m, 0.0)

    rows = jnp.arange(road.num_rows, dtype=jnp.int32)
    foremost = entry_ahead(jnp.full((road.num_rows,), here_m + sensor.ahead_m), rows, vehicles.position_m, state.head)
    entry = foremost[:, None] + 1 + jnp.arange(sensor.objects_per_row, dtype=jnp.int32)[None, :]
    in_row = entry < take(state.head, rows + 1)[:, None]
    entry = jnp.minimum(entry, vehicles.row.shape[0] - 1).reshape(-1)
    row = jnp.repeat(rows, sensor.objects_per_row)
    position = take(vehicles.position_m, entry)
    offset = position - here_m
    on_carriageway = take(road.is_carriageway.reshape(-1), row * road.num_segments + road.segment_at(position))
    is_there = in_row.reshape(-1) & ~take(has_arrived, entry)
    seen = is_there & valid & on_carriageway & (offset >= -sensor.behind_m) & (offset <= sensor.ahead_m)
    seen_subject = seen & (take(vehicles.vehicle_class, entry) == subject_class)
    if identity is not None:
        seen_subject &= take(vehicles.identity, entry) == identity

    track = take(vehicles.track, entry)
    is_new = seen & ~seen_subject & (track == UNSEEN)
    number = state.num_tracks + jnp.cumsum(is_new.astype(jnp.int32)) - 1
    track = jnp.where(is_new, number, track)
    target = jnp.where(is_new, entry, vehicles.row.shape[0])
    all_tracks = jnp.concatenate([vehicles.track, jnp.zeros((1,), jnp.int32)])
    all_tracks = all_tracks.at[target].set(track, mode="promise_in_bounds")[:-1]
    state = eqx.tree_at(
        lambda s: (s.vehicles.track, s.num_tracks), state, (all_tracks, state.num_tracks + jnp.sum(is_new))
    )
    frame = PerceptionFrame(
        time_s=time_s,
        valid=valid,
        subject_position_m=here_m,
        subject_speed_mps=speed,
        subject_acceleration_mps2=take(vehicles.acceleration_mps2, subject),
        num_lanes=take(road.num_lanes, road.segment_at(here_m)),
        object_valid=seen,
        object_is_subject=seen_subject,
        object_track=jnp.where(seen & ~seen_subject, track, NO_TRACK),
        object_row=row,
        object_offset_m=jnp.where(seen, offset, 0.0),
        object_speed_mps=jnp.where(seen, take(vehicles.speed_mps, entry), 0.0),
        object_lateral_m=jnp.zeros_like(offset),  # lane changes take one step here
        ahead_m=sensor.ahead_m,
        behind_m=sensor.behind_m,
    )
    return state, frame, entry
