"""Measures of car-following (Table 2, Eqs. 24-27)."""

from itertools import pairwise

from jaxcalib.measures.car_following import HEADWAY_BORDER_S, SPEED_BORDER_MPS
from jaxcalib.measures.measure import Deviation, Level, Measure, Percentile

VEHICLE = Level.VEHICLE


def following_measures() -> list[Measure]:
    """Return them for the subject vehicle and for the background traffic."""
    return [*_following("subject"), *_following("background"), *_spacing_by_speed()]


def _following(actor: str) -> list[Measure]:
    frames = f"{actor}_following_frames"
    censored = f"{actor}_headways_censored"

    def mean(name: str, description: str, numerator: str) -> Measure:
        return Measure(f"{actor}_{name}", description, VEHICLE, f"{actor}_{numerator}", frames, censored=censored)

    measures: list[Measure] = [
        mean("time_headway_s", "time headway, front to front, mean over observations", "headway_s"),
        mean("time_gap_s", "time gap, rear to front, mean over observations", "gap_s"),
        mean("spacing_m", "spacing while following, front to front", "spacing_m"),
        mean("following_speed_mps", "speed while following", "following_speed"),
        Deviation(
            f"{actor}_time_headway_deviation_s",
            "standard deviation of the time headway",
            VEHICLE,
            f"{actor}_headway_s",
            frames,
            squares=f"{actor}_headway_squared",
        ),
        Measure(
            f"{actor}_following_duration_s",
            "duration of car-following, as far as seen",
            VEHICLE,
            f"{actor}_following_time_s",
            f"{actor}_following_episodes",
        ),
        Measure(
            f"{actor}_following_distance_m",
            "distance of car-following, as far as seen",
            VEHICLE,
            f"{actor}_following_distance_m",
            f"{actor}_following_episodes",
        ),
    ]
    for share in (0.15, 0.5, 0.85):
        measures.append(
            Percentile(
                f"{actor}_time_headway_p{share * 100:.0f}_s",
                f"{share:.0%} of time headways are shorter",
                VEHICLE,
                f"{actor}_headway_bin",
                frames,
                borders=HEADWAY_BORDER_S,
                share=share,
            )
        )
    for index, (low, high) in enumerate(pairwise(HEADWAY_BORDER_S)):
        measures.append(
            Measure(
                f"{actor}_time_headway_share_{low:g}_{high:g}_s",
                f"share of time headways of {low:g} to {high:g} s",
                VEHICLE,
                f"{actor}_headway_bin[{index}]",
                frames,
            )
        )
    if actor == "background":
        measures += [
            Measure(
                "background_mean_time_headway_s",
                "time headway, mean over vehicles of their means (Eq. 25)",
                VEHICLE,
                "follower_headway_s",
                "followers",
            ),
            Measure(
                "background_mean_time_gap_s",
                "time gap, mean over vehicles of their means",
                VEHICLE,
                "follower_gap_s",
                "followers",
            ),
            Measure(
                "background_following_share",
                "share of time in which a vehicle seen follows another",
                VEHICLE,
                "background_following_frames",
                "vehicle_frames",
            ),
        ]
    return measures


def _spacing_by_speed() -> list[Measure]:
    return [
        Measure(
            f"background_time_gap_above_{low:g}_mps_s",
            f"time gap while following faster than {low:g} m/s, up to the next class",
            VEHICLE,
            f"following_speed_bin_gap_s[{index}]",
            f"following_speed_bin[{index}]",
        )
        for index, low in enumerate(SPEED_BORDER_MPS)
    ]
