"""What can be seen in one perception frame, given the frame before it.

The objects of a frame are sorted by (row, -position), so that leader and follower are neighbours in the arrays. Each
object is remembered by its track number from frame to frame; nothing else of the past is kept.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxcalib.case.safety_limits import SafetyLimits
from jaxcalib.measures.observed_road import ObservedRoad
from surrogate.road.perception import PerceptionFrame

SUBJECT_SLOT = 0  # of the track table; track n is in slot n + 1


class MeasureSettings(eqx.Module):
    """Conventions of the measures; the same for the field, the surrogate and SUMO."""

    road: ObservedRoad
    nominal_length_m: Float[Array, ""]  # length taken for every vehicle, since logs hold none
    least_speed_mps: Float[Array, ""]  # below it a time headway means nothing
    longest_headway_s: Float[Array, ""]  # a vehicle further behind its leader does not follow it
    limits: SafetyLimits[Float[Array, ""]]  # of the safety measures
    num_tracks: int = eqx.field(static=True)  # places for vehicles that are remembered during a drive
    # classes of the lane-changing distance within which none goes unseen
    num_target_gap_classes: int = eqx.field(static=True)


class Memory(eqx.Module):
    """What is remembered of each track from the last frame in which it was seen, and of the subject vehicle."""

    time_s: Float[Array, " track"]
    row: Float[Array, " track"]
    offset_m: Float[Array, " track"]
    speed_mps: Float[Array, " track"]
    is_following: Float[Array, " track"]
    off_centre_since_s: Float[Array, " track"]
    crossed: Float[Array, " track"]
    cut_in_s: Float[Array, ""]  # when a vehicle has last cut in before the subject vehicle; -inf if none has
    subject_acceleration_mps2: Float[Array, ""]  # in the last frame
    knows_acceleration: Float[Array, ""]  # 1 if it is known
    leader_braked_mps2: Float[Array, ""]  # hardest deceleration of its leader since that brakes; 0 if it does not
    approach_mps2: Float[Array, " track"]  # hardest deceleration that its approach has needed so far; 0 if it has none


class Scene(eqx.Module):
    """One frame, understood. Arrays run over the objects of the frame."""

    frame: PerceptionFrame
    settings: MeasureSettings  # conventions
    is_vehicle: Bool[Array, " object"]  # whether there is a vehicle at this place, the subject vehicle included
    is_background: Bool[Array, " object"]  # the same without the subject vehicle
    slot: Int[Array, " object"]  # slot in the track table; the last one where there is none
    position_m: Float[Array, " object"]  # front bumper along the route
    interval_s: Float[Array, ""]  # time since the frame before; 0 in the first
    is_tracked: Bool[Array, " object"]  # whether the vehicle was seen in the frame before
    previous_row: Float[Array, " object"]  # its row then
    previous_offset_m: Float[Array, " object"]  # its offset from the subject vehicle then
    previous_speed_mps: Float[Array, " object"]  # its speed then
    was_following: Bool[Array, " object"]  # whether it followed then
    off_centre_since_s: Float[Array, " object"]  # since when it has been off the centre of its lane; inf if it is not
    crossed: Bool[Array, " object"]  # whether it has changed lane since then
    crossing_s: Float[Array, " object"]  # duration of a lane change that is over in this frame; nan elsewhere
    has_leader: Bool[Array, " object"]  # whether a leader in its row is within the sensor's range
    spacing_m: Float[Array, " object"]  # leader's front bumper less own; inf without leader
    has_follower: Bool[Array, " object"]  # whether a follower in its row is within range
    headway_s: Float[Array, " object"]  # time headway, spacing / speed; inf without leader or below the least speed
    is_following: Bool[Array, " object"]  # whether the headway is shorter than the longest
    is_free: Bool[Array, " object"]  # whether it is known to be longer
    changes_lane: Bool[Array, " object"]  # whether the row is another one than in the frame before
    moves_left: Float[Array, " object"]  # -1, 0 or 1: direction of that change
    # space between the rear of the leader and the front of the follower; inf if one is not in range
    target_gap_m: Float[Array, " object"]
    seen_target_gap_m: Float[Array, " object"]  # as much of that space as is within range
    closing_mps: Float[Array, " object"]  # how much faster than its leader it is; 0 without, or if it is hardly so
    drac_mps2: Float[Array, " object"]  # deceleration that avoids a crash with a leader who keeps its speed
    approach_mps2: Float[Array, " object"]  # its greatest value since it has been closing in; 0 if it is not
    approached_mps2: Float[Array, " object"]  # the same up to the frame before
    acceleration_mps2: Float[Array, " object"]  # change of speed since the frame before; 0 if it was not seen then
    cuts_in: Bool[Array, " object"]  # whether it has become the subject vehicle's leader, while that stays in its lane
    since_cut_in_s: Float[Array, ""]  # time since that happened last, before this frame; inf if it did not
    leader_braking_mps2: Float[Array, ""]  # hardest deceleration of its leader since that brakes; 0 if it does not
    leader_braked_mps2: Float[Array, ""]  # the same up to the frame before
    knows_jerk: Bool[Array, ""]  # whether the subject vehicle was seen in the two frames before
    subject_jerk_mps3: Float[Array, ""]  # change of its acceleration; 0 if it is not known

    @property
    def is_subject(self) -> Bool[Array, " object"]:
        """Whether this object is the subject vehicle."""
        return self.frame.object_is_subject

    @property
    def gap_m(self) -> Float[Array, " object"]:
        """Leader's rear bumper less own front bumper."""
        return self.spacing_m - self.settings.nominal_length_m

    @property
    def time_gap_s(self) -> Float[Array, " object"]:
        """Gap over own speed, or over the least speed; inf without leader."""
        speed = jnp.maximum(self.frame.object_speed_mps, self.settings.least_speed_mps)
        return jnp.where(self.has_leader, self.gap_m, jnp.inf) / speed

    def at_subject(self, values: Array) -> Array:
        """Return the value at the subject vehicle."""
        return jnp.sum(jnp.where(self.is_subject, values, jnp.zeros_like(values)))


def nothing_remembered(num_tracks: int) -> Memory:
    """Return the memory before the first frame."""
    zero = jnp.zeros((num_tracks,), jnp.float32)
    never, none = jnp.full_like(zero, -jnp.inf), jnp.zeros((), jnp.float32)
    return Memory(never, zero, zero, zero, zero, -never, zero, none - jnp.inf, none, none, none, zero)


LEAST_CLOSING_MPS = 0.1  # less is the rounding of speeds
LEAST_GAP_M = 0.1  # nominal lengths may overlap where real ones do not
LEADER_BRAKES_MPS2 = 1.0  # more than traffic that swings does by itself
OFF_CENTRE_M = 0.4  # further from the centre of the lane, a vehicle is changing lane (half the play in a 3.2-m lane)


def look(frame: PerceptionFrame, memory: Memory, previous_s: Float[Array, ""], settings: MeasureSettings) -> Scene:
    """The scene of a frame; the frame before was at -inf if there was none."""
    valid, row, offset, speed = (
        frame.object_valid & frame.valid,
        frame.object_row,
        frame.object_offset_m,
        frame.object_speed_mps,
    )
    trash = settings.num_tracks - 1
    slot = jnp.where(frame.object_is_subject, SUBJECT_SLOT, frame.object_track + 1)
    slot = jnp.where(valid & (slot < trash), slot, trash)

    def recall(values: Float[Array, " track"]) -> Float[Array, " object"]:
        return values.at[slot].get(mode="promise_in_bounds")

    is_tracked = (recall(memory.time_s) == previous_s) & (slot != trash) & (previous_s > -jnp.inf)
    previous_row = recall(memory.row)

    nobody, edge = jnp.zeros((1,), bool), jnp.zeros((1,), offset.dtype)
    same_row = valid[1:] & valid[:-1] & (row[1:] == row[:-1])
    has_leader = jnp.concatenate([nobody, same_row])
    has_follower = jnp.concatenate([same_row, nobody])
    leader_offset = jnp.concatenate([edge, offset[:-1]])
    follower_offset = jnp.concatenate([offset[1:], edge])
    spacing = jnp.where(has_leader, leader_offset - offset, jnp.inf)
    seen_to = jnp.where(has_leader, leader_offset, frame.ahead_m) - settings.nominal_length_m
    seen_target_gap = seen_to - jnp.where(has_follower, follower_offset, -frame.behind_m)

    moves = valid & (speed > settings.least_speed_mps)
    headway = jnp.where(moves, spacing / jnp.maximum(speed, settings.least_speed_mps), jnp.inf)
    is_following = headway < settings.longest_headway_s
    seen_ahead = jnp.where(has_leader, spacing, frame.ahead_m - offset)
    is_free = moves & (seen_ahead >= settings.longest_headway_s * speed)

    order = settings.road.lateral_order
    here = order.at[row].get(mode="promise_in_bounds")
    before = order.at[previous_row.astype(jnp.int32)].get(mode="promise_in_bounds")
    changes = is_tracked & (previous_row != row)
    is_off_centre = jnp.abs(frame.object_lateral_m) > OFF_CENTRE_M  # false where the offset is not known
    is_centred = jnp.abs(frame.object_lateral_m) <= OFF_CENTRE_M
    since = jnp.where(is_tracked, recall(memory.off_centre_since_s), jnp.inf)
    had_crossed = is_tracked & (recall(memory.crossed) > 0)
    is_over = is_centred & (had_crossed | changes)
    # whoever is in the centre of one lane, and in the next frame in that of another, was not seen to cross: SUMO's
    # vehicles do not where changes take no time
    crossing = jnp.where(jnp.isfinite(since), frame.time_s - since, jnp.nan)
    previous_speed = recall(memory.speed_mps)
    interval = jnp.where(previous_s > -jnp.inf, frame.time_s - previous_s, 0.0)
    acceleration = jnp.where(is_tracked, speed - previous_speed, 0.0) / jnp.maximum(interval, 1e-3)
    is_seen_subject = frame.object_is_subject & is_tracked
    more = jnp.sum(jnp.where(is_seen_subject, acceleration - memory.subject_acceleration_mps2, 0.0))
    knows_jerk = jnp.any(is_seen_subject) & (memory.knows_acceleration > 0)
    stays = is_seen_subject & ~changes
    leader_brakes = jnp.concatenate([edge, -acceleration[:-1]])
    brakes = jnp.sum(jnp.where(stays & has_leader, leader_brakes, 0.0))
    leads_subject = jnp.concatenate([(stays & has_leader)[1:], nobody])
    cuts_in = leads_subject & changes
    faster = jnp.where(has_leader, speed - jnp.concatenate([edge, speed[:-1]]), 0.0)
    closing = jnp.where(faster > LEAST_CLOSING_MPS, faster, 0.0)
    drac = closing * closing / (2.0 * jnp.maximum(spacing - settings.nominal_length_m, LEAST_GAP_M))
    approached = jnp.where(is_tracked, recall(memory.approach_mps2), 0.0)
    return Scene(
        frame=frame,
        settings=settings,
        is_vehicle=valid,
        is_background=valid & ~frame.object_is_subject,
        slot=slot,
        position_m=frame.subject_position_m + offset,
        interval_s=interval,
        is_tracked=is_tracked,
        previous_row=previous_row,
        previous_offset_m=recall(memory.offset_m),
        previous_speed_mps=previous_speed,
        was_following=is_tracked & (recall(memory.is_following) > 0),
        off_centre_since_s=jnp.where(is_off_centre, jnp.minimum(since, frame.time_s), jnp.inf),
        crossed=(had_crossed | changes) & is_off_centre,
        crossing_s=jnp.where(is_over, crossing, jnp.nan),
        has_leader=has_leader,
        spacing_m=spacing,
        has_follower=has_follower,
        headway_s=headway,
        is_following=is_following,
        is_free=is_free,
        changes_lane=changes,
        moves_left=jnp.where(changes, jnp.sign(here - before), 0.0),
        target_gap_m=jnp.where(has_leader & has_follower, seen_target_gap, jnp.inf),
        seen_target_gap_m=seen_target_gap,
        closing_mps=closing,
        drac_mps2=drac,
        # the first frame in which it is seen counts for nothing that takes time, and begins no approach
        approach_mps2=jnp.where(is_tracked & (closing > 0.0), jnp.maximum(drac, approached), 0.0),
        approached_mps2=approached,
        acceleration_mps2=acceleration,
        cuts_in=cuts_in,
        since_cut_in_s=frame.time_s - memory.cut_in_s,
        leader_braking_mps2=jnp.where(
            brakes >= LEADER_BRAKES_MPS2, jnp.maximum(brakes, memory.leader_braked_mps2), 0.0
        ),
        leader_braked_mps2=memory.leader_braked_mps2,
        knows_jerk=knows_jerk,
        subject_jerk_mps3=jnp.where(knows_jerk, more / jnp.maximum(interval, 1e-3), 0.0),
    )


def remember(memory: Memory, scene: Scene) -> Memory:
    """Return the memory after a frame."""
    frame = scene.frame

    def note(values: Float[Array, " track"], news: Array) -> Float[Array, " track"]:
        return values.at[scene.slot].set(news.astype(jnp.float32), mode="promise_in_bounds")

    return Memory(
        time_s=note(memory.time_s, jnp.broadcast_to(frame.time_s, scene.slot.shape)),
        row=note(memory.row, frame.object_row),
        offset_m=note(memory.offset_m, frame.object_offset_m),
        speed_mps=note(memory.speed_mps, frame.object_speed_mps),
        is_following=note(memory.is_following, scene.is_following),
        off_centre_since_s=note(memory.off_centre_since_s, scene.off_centre_since_s),
        crossed=note(memory.crossed, scene.crossed),
        cut_in_s=jnp.where(jnp.any(scene.cuts_in), frame.time_s, memory.cut_in_s),
        subject_acceleration_mps2=scene.at_subject(scene.acceleration_mps2),
        knows_acceleration=scene.at_subject(scene.is_tracked.astype(jnp.float32)),
        leader_braked_mps2=scene.leader_braking_mps2,
        approach_mps2=note(memory.approach_mps2, scene.approach_mps2),
    )
