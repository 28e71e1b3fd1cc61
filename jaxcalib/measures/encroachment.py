"""How close lane changes come to others, and what the subject vehicle does once a vehicle has cut in.

A vehicle that changes lane takes a place that its new leader has just left and its new follower would have reached
next: the lesser of both times is the change's post-encroachment time. It is told in the first frame in the new lane,
for vehicles that keep their speeds. A neighbour out of range is further away than sensors see. Near the edge of their
range that may be nearer than the limit of a conflict: changes there are left out, whatever is seen of them.

Sources: post-encroachment time, Allen, Shin & Cooper (1978), Transp. Res. Rec. 667; told from gaps and speeds at the
change, as in the FHWA's surrogate safety assessment model (2008). The time watched after a cut-in: `SafetyLimits`.
Deviation: frames lie half a second apart, so that a gap is up to that much later than the change itself.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import LeftOut, Level, Measure, Percentile
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import MeasureSettings, Scene

VEHICLE = Level.VEHICLE
ENCROACHMENT_BORDER_S = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)


class Encroachment(Fold):
    """Lane changes of all vehicles, by the time that they leave to others."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        bins = indexed("encroachment_bin", len(ENCROACHMENT_BORDER_S) - 1)
        return (*bins, "encroaching_changes", "close_changes")

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        time_s, limit_s = post_encroachment_s(scene), scene.settings.limits.encroachment_s
        seen = scene.is_vehicle & scene.changes_lane & sees_for(scene, limit_s)
        in_bin = within(time_s, jnp.asarray(ENCROACHMENT_BORDER_S))
        return {
            "encroaching_changes": jnp.sum(seen.astype(jnp.float32)),
            "close_changes": jnp.sum((seen & (time_s < limit_s)).astype(jnp.float32)),
            **by_index("encroachment_bin", sums_by_class(in_bin, seen.astype(jnp.float32))),
        }


class AfterCutIn(Fold):
    """What the subject vehicle does while a cut-in is recent and it stays in its lane."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return ("after_cut_in_s", "after_cut_in_speed_loss_mps", "after_cut_in_braking_s")

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        limits = scene.settings.limits
        is_recent = scene.since_cut_in_s <= limits.after_cut_in_s
        watched = scene.is_subject & scene.is_tracked & ~scene.changes_lane & is_recent
        brakes_hard = watched & (scene.acceleration_mps2 < -limits.hard_braking_mps2)
        return {
            "after_cut_in_s": jnp.sum(jnp.where(watched, scene.interval_s, 0.0)),
            "after_cut_in_speed_loss_mps": -jnp.sum(
                jnp.where(watched, scene.acceleration_mps2 * scene.interval_s, 0.0)
            ),
            "after_cut_in_braking_s": jnp.sum(jnp.where(brakes_hard, scene.interval_s, 0.0)),
        }


def post_encroachment_s(scene: Scene) -> Float[Array, " object"]:
    """Time between leader and vehicle at its place, or vehicle and follower, the lesser one; inf with neither."""
    behind_leader = scene.time_gap_s
    nobody = jnp.full((1,), jnp.inf, behind_leader.dtype)
    before_follower = jnp.where(scene.has_follower, jnp.concatenate([behind_leader[1:], nobody]), jnp.inf)
    return jnp.maximum(jnp.minimum(behind_leader, before_follower), 0.0)


def sees_for(scene: Scene, time_s: Float[Array, ""]) -> Bool[Array, " object"]:
    """Whether whoever were that time ahead of or behind a vehicle, at its speed, would be seen."""
    frame = scene.frame
    reach_m = time_s * jnp.maximum(frame.object_speed_mps, scene.settings.least_speed_mps)
    reach_m = reach_m + scene.settings.nominal_length_m
    ahead = frame.ahead_m - frame.object_offset_m >= reach_m
    return ahead & (frame.object_offset_m + frame.behind_m >= reach_m)


def _measures(settings: MeasureSettings) -> list[Measure]:
    limits = settings.limits
    watched = f"in the {float(limits.after_cut_in_s):g} s after a cut-in"
    return [
        Percentile(
            "lane_change_pet_p15_s", "15% of post-encroachment times of lane changes are shorter", VEHICLE,
            "encroachment_bin", "encroaching_changes", borders=ENCROACHMENT_BORDER_S, share=0.15,
        ),
        Measure(
            "lane_change_conflict_share",
            f"share of lane changes with less than {float(limits.encroachment_s):g} s to another vehicle", VEHICLE,
            "close_changes", "encroaching_changes", left_out=LeftOut.SAFETY,
        ),
        Measure(
            "after_cut_in_deceleration_mps2", f"subject vehicle's mean deceleration {watched}", VEHICLE,
            "after_cut_in_speed_loss_mps", "after_cut_in_s", observations="cut_ins", left_out=LeftOut.SAFETY,
        ),
        Measure(
            "after_cut_in_hard_braking_share",
            f"share of time with more than {float(limits.hard_braking_mps2):g} m/s^2 of braking {watched}", VEHICLE,
            "after_cut_in_braking_s", "after_cut_in_s", observations="cut_ins", left_out=LeftOut.SAFETY,
        ),
    ]  # fmt: skip


GROUP = MeasureGroup(_measures, lambda settings: [Encroachment(), AfterCutIn()])
