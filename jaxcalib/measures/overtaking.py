"""Vehicles that pass the subject vehicle, and that it passes (Table 2)."""

import jax.numpy as jnp
from jaxtyping import Array

from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import Level, Measure
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import Scene

VEHICLE = Level.VEHICLE


class Overtaking(Fold):
    """Vehicles that pass the subject vehicle, and that it passes: their offset changes sign between two frames."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return (
            "overtaken",
            "overtaken_left",
            "overtaken_speed_difference",
            "overtakes",
            "overtakes_speed_difference",
            "overtaking_lateral",
        )

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
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


_MEASURES = (
    Measure("overtaken_per_drive", "vehicles that pass the subject vehicle", VEHICLE, "overtaken", "drives"),
    Measure("overtaken_left_share", "share of them on its left", VEHICLE, "overtaken_left", "overtaken"),
    Measure(
        "overtaken_speed_difference_mps", "how much faster they are", VEHICLE,
        "overtaken_speed_difference", "overtaken",
    ),
    Measure("overtakes_per_drive", "vehicles that the subject vehicle passes", VEHICLE, "overtakes", "drives"),
    Measure(
        "overtakes_speed_difference_mps", "how much slower they are", VEHICLE,
        "overtakes_speed_difference", "overtakes",
    ),
)  # fmt: skip

GROUP = MeasureGroup(lambda settings: _MEASURES, lambda settings: [Overtaking()])
