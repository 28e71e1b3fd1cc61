"""Frequency, distance and duration of lane changes (Table 2, Eqs. 28-31).

The paper's "lane-changing distance" is a gap: the space between the future leader's rear and the future follower's
front in the target lane at the moment of the change. It is taken in the first frame in which the vehicle is in its new
lane, and censored where one of the two is not within the sensor's range: then it is longer than what is seen of it.
Both kinds are counted by classes, from which a life table takes the mean.
"""

from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import Deviation, LeftOut, Level, Measure, Moe, Percentile, RestrictedMean
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import MeasureSettings, Scene
from sim_adapters.units import METRES_PER_KILOMETRE

VEHICLE = Level.VEHICLE

TARGET_GAP_CLASS_M = 10.0  # of the life table
TARGET_GAP_BORDER_M = (0.0, 20.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0, 130.0, 170.0, 220.0, 300.0)


class LaneChange(Fold):
    """Lane changes of the subject vehicle and of the background traffic."""

    num_sections: int = eqx.field(static=True)
    num_target_gap_classes: int = eqx.field(static=True)

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        names: list[str] = []
        for actor in ("subject", "background"):
            names += [f"{actor}_{part}" for part in _SUMS]
            names += indexed(f"{actor}_target_gap_bin", len(TARGET_GAP_BORDER_M) - 1)
            names += indexed(f"{actor}_target_gap_class", self.num_target_gap_classes)
            names += indexed(f"{actor}_target_gap_class_censored", self.num_target_gap_classes)
        names += ["tracked_distance_m", "lane_changers", "lane_changer_target_gap_m"]
        for part in ("section_left", "section_right", "section_distance_m"):
            names += indexed(part, self.num_sections)
        return tuple(names)

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        counted: dict[str, Array] = {}
        for actor, is_actor in (("subject", scene.is_subject), ("background", scene.is_background)):
            changes = is_actor & scene.changes_lane
            counted |= _sums(scene, actor, changes) | self._life_table(scene, actor, changes)
            over = jnp.where(is_actor & scene.is_vehicle, scene.crossing_s, jnp.nan)
            counted[f"{actor}_lane_change_durations"] = jnp.sum((~jnp.isnan(over)).astype(jnp.float32))
            counted[f"{actor}_lane_change_duration_s"] = jnp.nansum(over)
        observed = scene.is_background & scene.is_tracked
        distance = jnp.where(observed, scene.interval_s * scene.frame.object_speed_mps, 0.0)
        left = (scene.is_background & (scene.moves_left > 0)).astype(jnp.float32)
        right = (scene.is_background & (scene.moves_left < 0)).astype(jnp.float32)
        in_section = within(scene.position_m, scene.settings.road.section_border_m)
        counted["tracked_distance_m"] = jnp.sum(distance)
        for name, values in (("left", left), ("right", right), ("distance_m", distance)):
            counted |= by_index(f"section_{name}", sums_by_class(in_section, values))
        return counted

    def _life_table(self, scene: Scene, actor: str, changes: Array) -> dict[str, Array]:
        """Number of gaps that end in each class, and of those of which nothing is seen beyond it."""
        seen = jnp.maximum(scene.seen_target_gap_m, 0.0)  # an overlap is no gap
        low = TARGET_GAP_CLASS_M * jnp.arange(self.num_target_gap_classes, dtype=jnp.float32)
        in_class = (seen >= low[:, None]) & (seen < low[:, None] + TARGET_GAP_CLASS_M)
        is_known = jnp.isfinite(scene.target_gap_m)
        known, censored = ((changes & kind).astype(jnp.float32) for kind in (is_known, ~is_known))
        name = f"{actor}_target_gap_class"
        counted = by_index(name, sums_by_class(in_class, known))
        return counted | by_index(f"{name}_censored", sums_by_class(in_class, censored))

    def track_names(self) -> tuple[str, ...]:
        """Names of the sums over frames for each vehicle."""
        return ("target_gaps", "target_gap_m")

    def count_per_track(self, scene: Scene) -> dict[str, Float[Array, " object"]]:
        """A scene's part of these sums."""
        known = scene.is_background & scene.changes_lane & jnp.isfinite(scene.target_gap_m)
        return {
            "target_gaps": known.astype(jnp.float32),
            "target_gap_m": jnp.where(known, scene.target_gap_m, 0.0),
        }

    def settle(self, tracks: dict[str, Float[Array, " track"]]) -> dict[str, Array]:
        """Return sums over vehicles of their mean target gaps (Eq. 29)."""
        count = tracks["target_gaps"]
        mean = jnp.where(count > 0, tracks["target_gap_m"] / jnp.maximum(count, 1.0), 0.0)
        return {
            "lane_changers": jnp.sum((count > 0).astype(jnp.float32)),
            "lane_changer_target_gap_m": jnp.sum(mean),
        }


def num_target_gap_classes(ahead_m: float, behind_m: float, nominal_length_m: float) -> int:
    """Number of classes within what sensors see of a gap beside them whatever its length."""
    return max(int((min(ahead_m, behind_m) - nominal_length_m) / TARGET_GAP_CLASS_M), 1)


_SUMS = (
    "lane_changes",
    "lane_changes_left",
    "target_gaps",
    "target_gap_m",
    "target_gap_squared",
    "target_gaps_censored",
    "lead_gaps",
    "lead_gap_m",
    "lag_gaps",
    "lag_gap_m",
    "lane_change_durations",
    "lane_change_duration_s",
)


def _sums(scene: Scene, actor: str, changes: Array) -> dict[str, Array]:
    known = changes & jnp.isfinite(scene.target_gap_m)
    gap = jnp.where(known, scene.target_gap_m, 0.0)
    has_lead, has_lag = changes & scene.has_leader, changes & scene.has_follower
    offset = scene.frame.object_offset_m
    to_follower = offset - jnp.concatenate([offset[1:], offset[-1:]]) - scene.settings.nominal_length_m
    parts = {
        "lane_changes": changes,
        "lane_changes_left": changes & (scene.moves_left > 0),
        "target_gaps": known,
        "target_gap_m": gap,
        "target_gap_squared": gap * gap,
        "target_gaps_censored": changes & ~known,
        "lead_gaps": has_lead,
        "lead_gap_m": jnp.where(has_lead, scene.gap_m, 0.0),
        "lag_gaps": has_lag,
        "lag_gap_m": jnp.where(has_lag, to_follower, 0.0),
    }
    counted = {f"{actor}_{part}": jnp.sum(values.astype(jnp.float32)) for part, values in parts.items()}
    in_bin = within(gap, jnp.asarray(TARGET_GAP_BORDER_M))
    return counted | by_index(f"{actor}_target_gap_bin", sums_by_class(in_bin, known.astype(jnp.float32)))


def _folds(settings: MeasureSettings) -> list[Fold]:
    return [LaneChange(settings.road.num_sections, settings.num_target_gap_classes)]


def _measures(settings: MeasureSettings) -> list[Measure]:
    restricted = [
        _restricted_target_gap(actor, moe, settings.num_target_gap_classes)
        for actor, moe in (
            ("subject", Moe.SUBJECT_LANE_CHANGE_DISTANCE),
            ("background", Moe.BACKGROUND_LANE_CHANGE_DISTANCE),
        )
    ]
    return [*_of_actor("subject"), *_of_actor("background"), _VEHICLE_MEAN, *restricted]


def _of_actor(actor: str) -> list[Measure]:
    is_background = actor == "background"
    count, gaps, durations = f"{actor}_lane_changes", f"{actor}_target_gaps", f"{actor}_lane_change_durations"
    return [
        Measure(
            f"{actor}_lane_changes_pkm", "lane changes per km driven", VEHICLE,
            count, "tracked_distance_m" if is_background else "subject_distance_m", METRES_PER_KILOMETRE, count,
            left_out=LeftOut.FOLLOWS if is_background else None,  # from those by section
        ),
        Measure(
            f"{actor}_lane_changes_per_drive", "lane changes seen in a drive", VEHICLE, count, "drives",
            left_out=LeftOut.FOLLOWS,
        ),
        Measure(f"{actor}_left_share", "share of lane changes to the left", VEHICLE, f"{count}_left", count),
        Measure(
            f"{actor}_target_gap_m",
            "lane-changing distance: rear of new leader to front of new follower, mean over those seen in full",
            VEHICLE, f"{actor}_target_gap_m", gaps, censored=f"{actor}_target_gaps_censored",
            printed_moe=None if is_background else Moe.SUBJECT_LANE_CHANGE_DISTANCE,
        ),
        Deviation(
            f"{actor}_target_gap_deviation_m", "standard deviation of the lane-changing distance", VEHICLE,
            f"{actor}_target_gap_m", gaps, squares=f"{actor}_target_gap_squared",
        ),
        Measure(f"{actor}_lead_gap_m", "gap to the new leader", VEHICLE, f"{actor}_lead_gap_m", f"{actor}_lead_gaps"),
        Measure(f"{actor}_lag_gap_m", "gap to the new follower", VEHICLE, f"{actor}_lag_gap_m", f"{actor}_lag_gaps"),
        Measure(
            f"{actor}_lane_change_duration_s", "duration of a lane change", VEHICLE,
            f"{actor}_lane_change_duration_s", durations, left_out=LeftOut.SINGLE_STEPS,
        ),
        Percentile(
            f"{actor}_target_gap_median_m", "median lane-changing distance", VEHICLE, f"{actor}_target_gap_bin", gaps,
            borders=TARGET_GAP_BORDER_M,
        ),
        *(
            Measure(
                f"{actor}_target_gap_share_{low:g}_{high:g}_m",
                f"share of lane-changing distances of {low:g} to {high:g} m",
                VEHICLE, f"{actor}_target_gap_bin[{index}]", gaps, left_out=LeftOut.BIN,
            )
            for index, (low, high) in enumerate(pairwise(TARGET_GAP_BORDER_M))
        ),
    ]  # fmt: skip


_VEHICLE_MEAN = Measure(
    "background_mean_target_gap_m",
    "lane-changing distance seen in full, mean over vehicles of their means (Eq. 29)",
    VEHICLE,
    "lane_changer_target_gap_m",
    "lane_changers",
    censored="background_target_gaps_censored",
    printed_moe=Moe.BACKGROUND_LANE_CHANGE_DISTANCE,
)


def _restricted_target_gap(actor: str, moe: Moe, num_classes: int) -> Measure:
    limit_m = num_classes * TARGET_GAP_CLASS_M
    return RestrictedMean(
        f"{actor}_restricted_target_gap_m",
        f"lane-changing distance, each counted up to {limit_m:g} m, censored ones as far as seen",
        VEHICLE,
        f"{actor}_target_gap_class",
        f"{actor}_lane_changes",
        censored=f"{actor}_target_gaps_censored",
        moe=moe,
        censored_classes=f"{actor}_target_gap_class_censored",
        num_classes=num_classes,
        class_width=TARGET_GAP_CLASS_M,
    )


GROUP = MeasureGroup(_measures, _folds)
