"""Cut-ins and overtaking as the subject vehicle meets them (Table 2, Eq. 32)."""

import jax.numpy as jnp
from jaxtyping import Array

from jaxcalib.measures.fold import Fold
from jaxcalib.measures.scene import Scene


class CutIn(Fold):
    """Vehicles that change into the subject vehicle's lane and become its leader while it stays in its lane.

    The gap is rear to front, in the first frame in which the newcomer is in the lane.
    """

    def names(self) -> tuple[str, ...]:
        """Return the names of the tallies."""
        return ("cut_ins", "cut_in_gap_m", "cut_in_gap_squared", "cut_in_speed_difference", "cut_outs")

    def count(self, scene: Scene) -> dict[str, Array]:
        """Return what a scene adds."""
        frame = scene.frame
        subject_stays = scene.at_subject((scene.is_tracked & ~scene.changes_lane).astype(jnp.float32)) > 0
        subject_row = scene.at_subject(frame.object_row.astype(jnp.float32))
        nobody = jnp.zeros((1,), bool)
        is_subject_leader = jnp.concatenate([(scene.is_subject & scene.has_leader)[1:], nobody])
        cuts_in = is_subject_leader & scene.changes_lane & subject_stays
        leaves = (
            scene.is_background
            & scene.changes_lane
            & (scene.previous_row == subject_row)
            & (frame.object_offset_m > 0)
            & subject_stays
        )
        gap = jnp.where(cuts_in, frame.object_offset_m - scene.settings.nominal_length_m, 0.0)
        slower = jnp.where(cuts_in, frame.subject_speed_mps - frame.object_speed_mps, 0.0)
        return {
            "cut_ins": jnp.sum(cuts_in.astype(jnp.float32)),
            "cut_in_gap_m": jnp.sum(gap),
            "cut_in_gap_squared": jnp.sum(gap * gap),
            "cut_in_speed_difference": jnp.sum(slower),
            "cut_outs": jnp.sum(leaves.astype(jnp.float32)),
        }


class Overtaking(Fold):
    """Vehicles that pass the subject vehicle, and that it passes: their offset changes sign between two frames."""

    def names(self) -> tuple[str, ...]:
        """Return the names of the tallies."""
        return (
            "overtaken",
            "overtaken_left",
            "overtaken_speed_difference",
            "overtakes",
            "overtakes_speed_difference",
            "overtaking_lateral",
        )

    def count(self, scene: Scene) -> dict[str, Array]:
        """Return what a scene adds."""
        frame = scene.frame
        order = scene.settings.road.lateral_order.at[frame.object_row].get(mode="promise_in_bounds")
        side = order - scene.at_subject(order)
        observed = scene.is_background & scene.is_tracked
        passes = observed & (scene.previous_offset_m < 0) & (frame.object_offset_m >= 0)
        is_passed = observed & (scene.previous_offset_m >= 0) & (frame.object_offset_m < 0)
        faster = frame.object_speed_mps - frame.subject_speed_mps
        parts = {
            "overtaken": passes,
            "overtaken_left": passes & (side > 0),
            "overtaken_speed_difference": jnp.where(passes, faster, 0.0),
            "overtakes": is_passed,
            "overtakes_speed_difference": jnp.where(is_passed, -faster, 0.0),
            "overtaking_lateral": jnp.where(passes | is_passed, jnp.abs(side), 0.0),
        }
        return {name: jnp.sum(values.astype(jnp.float32)) for name, values in parts.items()}
