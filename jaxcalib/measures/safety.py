"""How near traffic comes to a crash: surrogate safety measures of rear-end conflicts and of cut-ins.

All are exposures, time in a state over the time in which it could be seen, so that drives of any length add up. A pair
of vehicles counts while the leader is in range; one whose gap does not close has no time to collision, and counts with
the time alone. A calibration matches none of it: the tails of traffic are what a simulation is judged by.

Sources: time to collision, its time-exposed and time-integrated forms, Minderhoud & Bovy (2001), Accid. Anal. Prev. 33,
eqs. 1, 3 and 5; deceleration rate to avoid a crash, Cooper & Ferguson (1976); brake threat number, Brannstrom, Sjoberg
& Coelingh (2008), IEEE ITSC, for a leader who keeps its acceleration until it stands. Those of the limits stand beside
them (`SafetyLimits`).
Deviation: gaps take the nominal length of every leader, and states are those of frames, half a second apart.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxcalib.case.safety_limits import SafetyLimits
from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import LeftOut, Level, Measure, Percentile
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import LEAST_CLOSING_MPS, LEAST_GAP_M, MeasureSettings, Scene
from sim_adapters.units import METRES_PER_KILOMETRE

VEHICLE = Level.VEHICLE

TTC_BORDER_S = (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0, 40.0)
DRAC_BORDER_MPS2 = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0, 1000.0)
KM_PER_1000_KM = 1000.0


class Conflicts(Fold):
    """Pairs of follower and leader, by how hard the follower would have to brake."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        names: list[str] = []
        for actor in ("subject", "background"):
            names += [f"{actor}_{part}" for part in _PARTS]
            names += indexed(f"{actor}_ttc_bin", len(TTC_BORDER_S) - 1)
            names += indexed(f"{actor}_approach_bin", len(DRAC_BORDER_MPS2) - 1)
        return (*names, "cut_in_time_gap_s", "cut_in_drac_mps2")

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        limits, speed = scene.settings.limits, scene.frame.object_speed_mps
        leader_speed = _of_leader(speed)
        gap = jnp.maximum(scene.gap_m, LEAST_GAP_M)
        closing, drac = scene.closing_mps, scene.drac_mps2
        closes = closing > 0.0
        ttc = jnp.where(closes, gap / jnp.where(closes, closing, 1.0), jnp.inf)
        acceleration = scene.acceleration_mps2
        needed = braking_needed(gap, speed, leader_speed, _of_leader(acceleration))
        threat = jnp.where(scene.has_leader, needed / limits.full_braking_mps2, 0.0)
        counted: dict[str, Array] = {}
        for actor, is_actor in (("subject", scene.is_subject & scene.is_vehicle), ("background", scene.is_background)):
            seen = is_actor & scene.has_leader & scene.is_tracked
            time_s = jnp.where(seen, scene.interval_s, 0.0)
            braking = is_actor & scene.is_tracked & (acceleration < -limits.hard_braking_mps2)
            parts = {
                "behind_leader_s": time_s,
                "ttc_exposed_s": jnp.where(ttc < limits.ttc_s, time_s, 0.0),
                "ttc_integral_s2": time_s * jnp.maximum(limits.ttc_s - ttc, 0.0),
                "near_miss_s": jnp.where((ttc < limits.near_miss_ttc_s) & (drac > limits.drac_mps2), time_s, 0.0),
                "drac_exposed_s": jnp.where(drac > limits.drac_mps2, time_s, 0.0),
                "threat_exposed_s": jnp.where(threat > limits.threat_number, time_s, 0.0),
                "approaching_frames": (seen & closes).astype(jnp.float32),
                "hard_braking_s": jnp.where(braking, scene.interval_s, 0.0),
                "distance_seen_m": jnp.where(is_actor & scene.is_tracked, scene.interval_s * speed, 0.0),
            }
            counted |= {f"{actor}_{part}": jnp.sum(values) for part, values in parts.items()}
            in_bin = sums_by_class(within(ttc, jnp.asarray(TTC_BORDER_S)), (seen & closes).astype(jnp.float32))
            counted |= by_index(f"{actor}_ttc_bin", in_bin)
            counted |= by_index(f"{actor}_approach_bin", _approaches(scene, seen))
        return counted | _at_cut_in(scene, gap, drac)


_PARTS = (
    "behind_leader_s",
    "ttc_exposed_s",
    "ttc_integral_s2",
    "near_miss_s",
    "drac_exposed_s",
    "threat_exposed_s",
    "approaching_frames",
    "hard_braking_s",
    "distance_seen_m",
)


def braking_needed(
    gap_m: Float[Array, " object"],
    speed_mps: Float[Array, " object"],
    leader_speed_mps: Float[Array, " object"],
    leader_acceleration_mps2: Float[Array, " object"],
) -> Float[Array, " object"]:
    """Deceleration that just avoids a crash, in m/s^2; 0 where none is needed.

    A leader who brakes goes on to do so until it stands, so that the follower has to stand within the gap and the
    leader's way; who closes in has to match the leader's speed before, if that is still moving then.
    """
    braking = jnp.maximum(-leader_acceleration_mps2, 0.0)
    closing = jnp.maximum(speed_mps - leader_speed_mps, 0.0)
    while_moving = braking + closing * closing / (2.0 * gap_m)
    leader_way_m = leader_speed_mps * leader_speed_mps / (2.0 * jnp.maximum(braking, 1e-3))
    to_stand = speed_mps * speed_mps / (2.0 * (gap_m + leader_way_m))
    # the follower who needs `while_moving` stands later than the leader: then the leader stands first
    stands_first = (braking > 0.0) & (speed_mps * braking > leader_speed_mps * while_moving)
    to_match = jnp.where((closing > 0.0) & ~stands_first, while_moving, 0.0)
    needed = jnp.maximum(to_match, jnp.where(braking > 0.0, to_stand, 0.0))
    return jnp.where(speed_mps > LEAST_CLOSING_MPS, needed, 0.0)


def _approaches(scene: Scene, seen: Bool[Array, " object"]) -> Float[Array, " class"]:
    """Approaches by the hardest deceleration that they need: one that becomes harder goes over to the next class.

    An approach lasts as long as the gap to whoever leads closes.
    """
    weight = seen.astype(jnp.float32)
    borders = jnp.asarray((*DRAC_BORDER_MPS2[:-1], jnp.inf))
    goes_on = weight * (scene.approach_mps2 > 0.0) * (scene.approached_mps2 > 0.0)
    so_far = sums_by_class(within(scene.approach_mps2, borders), weight * (scene.approach_mps2 > 0.0))
    return so_far - sums_by_class(within(scene.approached_mps2, borders), goes_on)


def _of_leader(values: Float[Array, " object"]) -> Float[Array, " object"]:
    """The value of the object before: the leader's, where there is one."""
    return jnp.concatenate([values[:1], values[:-1]])


def _at_cut_in(scene: Scene, gap_m: Float[Array, " object"], drac: Float[Array, " object"]) -> dict[str, Array]:
    """What the subject vehicle has left when a vehicle has cut in, while it stays in its lane itself."""
    meets = scene.is_subject & jnp.any(scene.cuts_in)
    speed = jnp.maximum(scene.frame.object_speed_mps, scene.settings.least_speed_mps)
    return {
        "cut_in_time_gap_s": jnp.sum(jnp.where(meets, gap_m / speed, 0.0)),
        "cut_in_drac_mps2": jnp.sum(jnp.where(meets, drac, 0.0)),
    }


def _all(settings: MeasureSettings) -> list[Measure]:
    limits: SafetyLimits[float] = SafetyLimits(*(float(limit) for limit in settings.limits))
    return [*_of_actor("subject", limits), *_of_actor("background", limits), *_OF_CUT_INS]


def _of_actor(actor: str, limits: SafetyLimits[float]) -> list[Measure]:
    behind = f"{actor}_behind_leader_s"

    def exposure(name: str, description: str, tally: str, denominator: str = behind, scale: float = 1.0) -> Measure:
        # what was seen is the time in that state: a denominator of hours says nothing of it
        return Measure(
            f"{actor}_{name}", description, VEHICLE, f"{actor}_{tally}", denominator, scale,
            observations=f"{actor}_{tally}", left_out=LeftOut.SAFETY,
        )  # fmt: skip

    distance, per_km = f"{actor}_distance_seen_m", METRES_PER_KILOMETRE
    return [
        exposure("ttc_exposed_share", f"share of time with a time to collision below {limits.ttc_s:g} s (TET)",
                 "ttc_exposed_s"),
        exposure("ttc_integral_s", f"mean shortfall of the time to collision below {limits.ttc_s:g} s (TIT / time)",
                 "ttc_integral_s2"),
        exposure("drac_exposed_share", f"share of time that needs more than {limits.drac_mps2:g} m/s^2 to avoid a "
                 "crash",
                 "drac_exposed_s"),
        exposure("threat_exposed_share", f"share of time with a brake threat number above {limits.threat_number:g}",
                 "threat_exposed_s"),
        exposure("near_miss_s_p1000km", f"time with less than {limits.near_miss_ttc_s:g} s to a crash that more "
                 f"than {limits.drac_mps2:g} m/s^2 avoids, per 1000 km", "near_miss_s", distance,
                 per_km * KM_PER_1000_KM),
        exposure("hard_braking_s_pkm", f"time with more than {limits.hard_braking_mps2:g} m/s^2 of braking, per km",
                 "hard_braking_s", distance, per_km),
        *(
            Percentile(
                f"{actor}_ttc_p{share * 100:02.0f}_s", f"{share:.0%} of times to collision are shorter, while a gap "
                "closes", VEHICLE, f"{actor}_ttc_bin", f"{actor}_approaching_frames", borders=TTC_BORDER_S, share=share,
            )
            for share in (0.01, 0.05, 0.15)
        ),
    ]  # fmt: skip


_OF_CUT_INS = (
    Measure(
        "cut_in_time_gap_s", "time gap that a cut-in leaves", VEHICLE, "cut_in_time_gap_s", "cut_ins",
        left_out=LeftOut.SAFETY,
    ),
    Measure(
        "cut_in_drac_mps2", "deceleration that a cut-in asks for", VEHICLE, "cut_in_drac_mps2", "cut_ins",
        left_out=LeftOut.SAFETY,
    ),
)  # fmt: skip

GROUP = MeasureGroup(_all, lambda settings: [Conflicts()])
