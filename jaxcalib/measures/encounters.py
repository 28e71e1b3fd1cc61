"""What the subject vehicle meets: cut-ins, cut-outs, leaders that brake, neighbours that join behind it, by severity.

Each is an event of a kind and of one of three severities, so that a simulation can be asked which of the field's
encounters it makes, and which of its own the field has. The severities are this project's: time gaps of 1 and 2 s that
are left, and decelerations of the leader from 1, 2 and 3 m/s^2 on, the hardest while it brakes.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxcalib.measures.cut_in import leaves_ahead
from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import LeftOut, Level, Measure
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import LEADER_BRAKES_MPS2, Scene

KINDS = {
    "cut_in": "a vehicle cuts in",
    "cut_out": "the leader leaves the lane",
    "braking_leader": "the leader brakes",
    "joining_follower": "a vehicle changes into the lane behind",
}
SEVERITIES = ("mild", "medium", "severe")
GAP_BORDERS_S = (2.0, 1.0)  # below them an encounter is medium, and severe
BRAKING_BORDERS_MPS2 = (LEADER_BRAKES_MPS2, 2.0, 3.0)


def encounter_tally(kind: str, severity: str) -> str:
    """Return the name of the tally that counts the encounters of a kind and severity."""
    return f"encounters_{kind}_{severity}"


class Encounters(Fold):
    """Encounters while the subject vehicle stays in its lane; who joins behind, by the gap to it."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return tuple(encounter_tally(kind, severity) for kind in KINDS for severity in SEVERITIES)

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        time_gap = scene.time_gap_s
        gap_ahead = _of_subject(scene, time_gap)
        leader_offset = _of_subject(scene, scene.spacing_m)
        leader_leaves = jnp.any(leaves_ahead(scene) & (scene.frame.object_offset_m < leader_offset))
        stays = scene.is_subject & scene.is_tracked & ~scene.changes_lane
        is_follower = jnp.concatenate([jnp.zeros((1,), bool), stays[:-1]]) & scene.has_leader
        joins = is_follower & scene.changes_lane
        worst, before = (_braking_class(each) for each in (scene.leader_braking_mps2, scene.leader_braked_mps2))
        # braking that becomes harder goes over to the next severity; when it is over, it stays where it is
        goes_over = jnp.where(jnp.any(worst > 0.0), worst - before, 0.0)
        return {
            **_by_gap("cut_in", jnp.any(scene.cuts_in), gap_ahead),
            **_by_gap("cut_out", leader_leaves, gap_ahead),
            **_by_gap("joining_follower", jnp.any(joins), jnp.sum(jnp.where(joins, time_gap, 0.0))),
            **{encounter_tally("braking_leader", severity): goes_over[k] for k, severity in enumerate(SEVERITIES)},
        }


def _of_subject(scene: Scene, values: Float[Array, " object"]) -> Float[Array, ""]:
    """The value at the subject vehicle; inf where it has no leader."""
    leads_on = scene.is_subject & scene.has_leader
    return jnp.where(jnp.any(leads_on), jnp.sum(jnp.where(leads_on, values, 0.0)), jnp.inf)


def _by_gap(kind: str, meets: Bool[Array, ""], gap_s: Float[Array, ""]) -> dict[str, Array]:
    is_medium, is_severe = (gap_s < border for border in GAP_BORDERS_S)
    classes = (~is_medium, is_medium & ~is_severe, is_severe)
    return {
        encounter_tally(kind, severity): (meets & is_such).astype(jnp.float32)
        for severity, is_such in zip(SEVERITIES, classes, strict=True)
    }


def _braking_class(braking_mps2: Float[Array, ""]) -> Float[Array, " severity"]:
    """1 for the severity of a deceleration, 0 for the others; all 0 where nobody brakes."""
    least = jnp.asarray(BRAKING_BORDERS_MPS2)
    return ((braking_mps2 >= least) & (braking_mps2 < jnp.append(least[1:], jnp.inf))).astype(jnp.float32)


_MEASURES = tuple(
    Measure(
        f"{kind}_{severity}_per_drive", f"{what}: {severity} encounters per drive", Level.VEHICLE,
        encounter_tally(kind, severity), "drives", observations=encounter_tally(kind, severity),
        left_out=LeftOut.BIN,
    )
    for kind, what in KINDS.items()
    for severity in SEVERITIES
)  # fmt: skip

GROUP = MeasureGroup(lambda settings: _MEASURES, lambda settings: [Encounters()])
