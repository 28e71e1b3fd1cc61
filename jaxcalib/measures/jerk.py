"""How smoothly the subject vehicle drives: the root mean square of its jerk.

Jerk is between mean accelerations of neighbouring frames, half a second apart: what is shorter averages out, in the
field as in both simulators. Squares of accelerations are counted with the trip (`car_following`).
"""

import jax.numpy as jnp
from jaxtyping import Array

from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import LeftOut, Level, RootMeanSquare
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import Scene


class Jerk(Fold):
    """Squares of the subject vehicle's jerk."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return ("subject_jerk_frames", "subject_jerk_squares")

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        return {
            "subject_jerk_frames": scene.knows_jerk.astype(jnp.float32),
            "subject_jerk_squares": scene.subject_jerk_mps3 * scene.subject_jerk_mps3,
        }


_MEASURES = (
    RootMeanSquare(
        "subject_jerk_rms_mps3", "root mean square of the subject vehicle's jerk", Level.VEHICLE,
        "subject_jerk_squares", "subject_jerk_frames", left_out=LeftOut.SINGLE_STEPS,
    ),
)  # fmt: skip

GROUP = MeasureGroup(lambda settings: _MEASURES, lambda settings: [Jerk()])
