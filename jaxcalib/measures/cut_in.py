"""Cut-ins as the subject vehicle meets them (Table 2, Eq. 32)."""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import Deviation, LeftOut, Level, Measure, Moe
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import Scene
from sim_adapters.units import METRES_PER_KILOMETRE

VEHICLE = Level.VEHICLE


class CutIn(Fold):
    """Vehicles that change into the subject vehicle's lane and become its leader while it stays in its lane.

    The gap is rear to front, in the first frame in which the newcomer is in the lane.
    """

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return ("cut_ins", "cut_in_gap_m", "cut_in_gap_squared", "cut_in_speed_difference", "cut_outs")

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        frame = scene.frame
        cuts_in = scene.cuts_in
        gap = jnp.where(cuts_in, frame.object_offset_m - scene.settings.nominal_length_m, 0.0)
        slower = jnp.where(cuts_in, frame.subject_speed_mps - frame.object_speed_mps, 0.0)
        return {
            "cut_ins": jnp.sum(cuts_in.astype(jnp.float32)),
            "cut_in_gap_m": jnp.sum(gap),
            "cut_in_gap_squared": jnp.sum(gap * gap),
            "cut_in_speed_difference": jnp.sum(slower),
            "cut_outs": jnp.sum(leaves_ahead(scene).astype(jnp.float32)),
        }


def leaves_ahead(scene: Scene) -> Bool[Array, " object"]:
    """Whether a vehicle ahead has left the lane in which the subject vehicle stays."""
    subject_row = scene.at_subject(scene.frame.object_row.astype(jnp.float32))
    subject_stays = scene.at_subject((scene.is_tracked & ~scene.changes_lane).astype(jnp.float32)) > 0
    from_subject_row = scene.is_background & scene.changes_lane & (scene.previous_row == subject_row)
    return from_subject_row & (scene.frame.object_offset_m > 0) & subject_stays


_MEASURES = (
    Measure(
        "cut_ins_per_drive", "cut-ins in front of the subject vehicle", VEHICLE, "cut_ins", "drives", moe=Moe.CUT_INS
    ),
    Measure(
        "cut_ins_pkm", "cut-ins per km", VEHICLE, "cut_ins", "subject_distance_m", METRES_PER_KILOMETRE,
        observations="cut_ins", left_out=LeftOut.FOLLOWS,
    ),
    Measure("cut_in_gap_m", "gap of a cut-in", VEHICLE, "cut_in_gap_m", "cut_ins"),
    Deviation(
        "cut_in_gap_deviation_m", "standard deviation of that gap", VEHICLE, "cut_in_gap_m", "cut_ins",
        squares="cut_in_gap_squared",
    ),
    Measure(
        "cut_in_speed_difference_mps", "subject vehicle's speed less that of the newcomer", VEHICLE,
        "cut_in_speed_difference", "cut_ins",
    ),
    Measure("cut_outs_per_drive", "vehicles that leave the lane ahead", VEHICLE, "cut_outs", "drives"),
)  # fmt: skip

GROUP = MeasureGroup(lambda settings: _MEASURES, lambda settings: [CutIn()])
