"""Headways, spacing, duration and oscillation of car-following (Table 2, Eqs. 24-27).

A *time headway* is front to front, spacing / speed; a *time gap* is rear to front, gap / speed. The paper says
"headway" and "t"; the MoEs use the time headway, and the time gap is reported beside it. A vehicle follows if its time
headway is shorter than the longest in the settings; without a leader in range, or with one further away, it does not,
and its headway is censored, not short.
"""

from itertools import pairwise

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import Deviation, LeftOut, Level, Measure, Moe, Percentile
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import MeasureSettings, Scene

VEHICLE = Level.VEHICLE

HEADWAY_BORDER_S = (0.0, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)
SPEED_BORDER_MPS = (0.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0)  # the last class is open


class CarFollowing(Fold):
    """Car-following of the subject vehicle and of the background traffic."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        names: list[str] = []
        for actor in ("subject", "background"):
            names += [f"{actor}_{part}" for part in _SUMS]
            names += indexed(f"{actor}_headway_bin", len(HEADWAY_BORDER_S) - 1)
        names += indexed("following_speed_bin", len(SPEED_BORDER_MPS))
        names += indexed("following_speed_bin_gap_s", len(SPEED_BORDER_MPS))
        names += ["background_frames", "followers", "follower_headway_s", "follower_gap_s"]
        names += ["acceleration_squared", "acceleration_frames"]
        return tuple(names)

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        counted: dict[str, Array] = {}
        for actor, is_actor in (("subject", scene.is_subject & scene.is_vehicle), ("background", scene.is_background)):
            counted |= _sums(scene, actor, is_actor)
        follows = scene.is_background & scene.is_following
        speed = scene.frame.object_speed_mps
        in_class = within(speed, jnp.asarray((*SPEED_BORDER_MPS, jnp.inf)))
        gap_s = jnp.where(follows, scene.gap_m / jnp.maximum(speed, 0.1), 0.0)
        counted |= by_index("following_speed_bin", sums_by_class(in_class, follows.astype(jnp.float32)))
        counted |= by_index("following_speed_bin_gap_s", sums_by_class(in_class, gap_s))
        counted["background_frames"] = jnp.sum(scene.is_background.astype(jnp.float32))
        was_seen = scene.is_background & scene.is_tracked & (scene.interval_s > 0)
        change = (speed - scene.previous_speed_mps) / jnp.maximum(scene.interval_s, 1e-3)
        counted["acceleration_squared"] = jnp.sum(jnp.where(was_seen, change * change, 0.0))
        counted["acceleration_frames"] = jnp.sum(was_seen.astype(jnp.float32))
        return counted

    def track_names(self) -> tuple[str, ...]:
        """Names of the sums over frames for each vehicle."""
        return ("following_frames", "headway_s", "gap_s")

    def count_per_track(self, scene: Scene) -> dict[str, Float[Array, " object"]]:
        """A scene's part of these sums."""
        follows = scene.is_background & scene.is_following
        speed = jnp.maximum(scene.frame.object_speed_mps, scene.settings.least_speed_mps)
        return {
            "following_frames": follows.astype(jnp.float32),
            "headway_s": jnp.where(follows, scene.headway_s, 0.0),
            "gap_s": jnp.where(follows, scene.gap_m / speed, 0.0),
        }

    def settle(self, tracks: dict[str, Float[Array, " track"]]) -> dict[str, Array]:
        """Return sums over vehicles of their mean headways (Eq. 25)."""
        frames = tracks["following_frames"]
        follows = frames > 0
        return {
            "followers": jnp.sum(follows.astype(jnp.float32)),
            "follower_headway_s": jnp.sum(jnp.where(follows, tracks["headway_s"] / jnp.maximum(frames, 1.0), 0.0)),
            "follower_gap_s": jnp.sum(jnp.where(follows, tracks["gap_s"] / jnp.maximum(frames, 1.0), 0.0)),
        }


_SUMS = (
    "following_frames",
    "headway_s",
    "headway_squared",
    "gap_s",
    "spacing_m",
    "following_speed",
    "following_distance_m",
    "following_time_s",
    "following_episodes",
    "headways_censored",
)


def _sums(scene: Scene, actor: str, is_actor: Array) -> dict[str, Array]:
    follows = is_actor & scene.is_following
    weight = follows.astype(jnp.float32)
    speed = scene.frame.object_speed_mps
    headway = jnp.where(follows, scene.headway_s, 0.0)
    drives_on = follows & scene.was_following
    begins = follows & ~scene.was_following
    parts = {
        "following_frames": weight,
        "headway_s": headway,
        "headway_squared": headway * headway,
        "gap_s": jnp.where(follows, scene.gap_m / jnp.maximum(speed, 0.1), 0.0),
        "spacing_m": jnp.where(follows, scene.spacing_m, 0.0),
        "following_speed": weight * speed,
        "following_distance_m": jnp.where(drives_on, scene.interval_s * speed, 0.0),
        "following_time_s": jnp.where(drives_on, scene.interval_s, 0.0),
        "following_episodes": begins.astype(jnp.float32),
        "headways_censored": (is_actor & ~scene.is_following).astype(jnp.float32),
    }
    counted = {f"{actor}_{part}": jnp.sum(values) for part, values in parts.items()}
    in_bin = within(headway, jnp.asarray(HEADWAY_BORDER_S))
    return counted | by_index(f"{actor}_headway_bin", sums_by_class(in_bin, weight))


def _measures(settings: MeasureSettings) -> list[Measure]:
    del settings
    return [*_of_actor("subject"), *_of_actor("background"), *_VEHICLE_MEANS, *_BY_SPEED]


def _of_actor(actor: str) -> list[Measure]:
    is_background = actor == "background"
    frames, episodes = f"{actor}_following_frames", f"{actor}_following_episodes"
    follows = LeftOut.FOLLOWS if is_background else None  # the mean over vehicles of their means is matched

    def mean(name: str, description: str, tally: str, left_out: LeftOut | None, moe: Moe | None = None) -> Measure:
        return Measure(
            f"{actor}_{name}", description, VEHICLE, f"{actor}_{tally}", frames,
            censored=f"{actor}_headways_censored", left_out=left_out, moe=moe,
        )  # fmt: skip

    return [
        mean(
            "time_headway_s", "time headway, front to front, mean over observations", "headway_s", follows,
            None if is_background else Moe.SUBJECT_TIME_HEADWAY,
        ),
        mean("time_gap_s", "time gap, rear to front, mean over observations", "gap_s", follows),
        mean("spacing_m", "spacing while following, front to front", "spacing_m", LeftOut.FOLLOWS),
        mean("following_speed_mps", "speed while following", "following_speed", None),
        Deviation(
            f"{actor}_time_headway_deviation_s", "standard deviation of the time headway", VEHICLE,
            f"{actor}_headway_s", frames, squares=f"{actor}_headway_squared",
        ),
        Measure(
            f"{actor}_following_duration_s", "duration of car-following, as far as seen", VEHICLE,
            f"{actor}_following_time_s", episodes,
        ),
        Measure(
            f"{actor}_following_distance_m", "distance of car-following, as far as seen", VEHICLE,
            f"{actor}_following_distance_m", episodes, left_out=follows,
        ),
        *(
            Percentile(
                f"{actor}_time_headway_p{share * 100:.0f}_s", f"{share:.0%} of time headways are shorter", VEHICLE,
                f"{actor}_headway_bin", frames, borders=HEADWAY_BORDER_S, share=share,
            )
            for share in (0.15, 0.5, 0.85)
        ),
        *(
            Measure(
                f"{actor}_time_headway_share_{low:g}_{high:g}_s", f"share of time headways of {low:g} to {high:g} s",
                VEHICLE, f"{actor}_headway_bin[{index}]", frames, left_out=LeftOut.BIN,
            )
            for index, (low, high) in enumerate(pairwise(HEADWAY_BORDER_S))
        ),
    ]  # fmt: skip


_VEHICLE_MEANS = (
    Measure(
        "background_mean_time_headway_s", "time headway, mean over vehicles of their means (Eq. 25)", VEHICLE,
        "follower_headway_s", "followers", moe=Moe.BACKGROUND_TIME_HEADWAY,
    ),
    Measure(
        "background_mean_time_gap_s", "time gap, mean over vehicles of their means", VEHICLE,
        "follower_gap_s", "followers",
    ),
    Measure(
        "background_following_share", "share of time in which a vehicle seen follows another", VEHICLE,
        "background_following_frames", "background_frames",
    ),
)  # fmt: skip
_BY_SPEED = tuple(
    Measure(
        f"background_time_gap_above_{low:g}_mps_s",
        f"time gap while following faster than {low:g} m/s, up to the next class",
        VEHICLE,
        f"following_speed_bin_gap_s[{index}]",
        f"following_speed_bin[{index}]",
    )
    for index, low in enumerate(SPEED_BORDER_MPS)
)

GROUP = MeasureGroup(_measures, lambda settings: [CarFollowing()])
