"""Measures of lane changes, cut-ins and overtaking (Table 2, Eqs. 28-32)."""

from itertools import pairwise

from jaxcalib.measures.lane_change import TARGET_GAP_BORDER_M, TARGET_GAP_CLASS_M
from jaxcalib.measures.measure import Deviation, Level, Measure, Percentile, RestrictedMean
from sim_adapters.units import METRES_PER_KILOMETRE

VEHICLE = Level.VEHICLE
PER_KM = METRES_PER_KILOMETRE


def lane_change_measures(num_target_gap_classes: int) -> list[Measure]:
    """Return them for the subject vehicle and for the background traffic.

    Args:
        num_target_gap_classes: classes of the life table of lane-changing distances.
    """
    actors = ("subject", "background")
    restricted = [_restricted_target_gap(actor, num_target_gap_classes) for actor in actors]
    return [*_lane_changes("subject"), *_lane_changes("background"), *_lane_changers(), *restricted, *_encounters()]


def _restricted_target_gap(actor: str, num_classes: int) -> Measure:
    limit_m = num_classes * TARGET_GAP_CLASS_M
    return RestrictedMean(
        f"{actor}_restricted_target_gap_m",
        f"lane-changing distance, each counted up to {limit_m:g} m, censored ones as far as seen",
        VEHICLE,
        f"{actor}_target_gap_class",
        f"{actor}_lane_changes",
        censored=f"{actor}_target_gaps_censored",
        censored_classes=f"{actor}_target_gap_class_censored",
        num_classes=num_classes,
        class_width=TARGET_GAP_CLASS_M,
    )


def _lane_changes(actor: str) -> list[Measure]:
    gaps, censored = f"{actor}_target_gaps", f"{actor}_target_gaps_censored"
    exposure = "subject_distance_m" if actor == "subject" else "tracked_distance_m"
    count = f"{actor}_lane_changes"
    measures: list[Measure] = [
        Measure(f"{actor}_lane_changes_pkm", "lane changes per km driven", VEHICLE, count, exposure, PER_KM, count),
        Measure(f"{actor}_lane_changes_per_drive", "lane changes seen in a drive", VEHICLE, count, "drives"),
        Measure(f"{actor}_left_share", "share of lane changes to the left", VEHICLE, f"{count}_left", count),
        Measure(
            f"{actor}_target_gap_m",
            "lane-changing distance: rear of new leader to front of new follower, mean over those seen in full",
            VEHICLE,
            f"{actor}_target_gap_m",
            gaps,
            censored=censored,
        ),
        Deviation(
            f"{actor}_target_gap_deviation_m",
            "standard deviation of the lane-changing distance",
            VEHICLE,
            f"{actor}_target_gap_m",
            gaps,
            squares=f"{actor}_target_gap_squared",
        ),
        Measure(f"{actor}_lead_gap_m", "gap to the new leader", VEHICLE, f"{actor}_lead_gap_m", f"{actor}_lead_gaps"),
        Measure(f"{actor}_lag_gap_m", "gap to the new follower", VEHICLE, f"{actor}_lag_gap_m", f"{actor}_lag_gaps"),
        Measure(
            f"{actor}_lane_change_duration_s",
            "duration of a lane change",
            VEHICLE,
            f"{actor}_lane_change_duration_s",
            f"{actor}_lane_change_durations",
        ),
        Percentile(
            f"{actor}_target_gap_median_m",
            "median lane-changing distance",
            VEHICLE,
            f"{actor}_target_gap_bin",
            gaps,
            borders=TARGET_GAP_BORDER_M,
        ),
    ]
    for index, (low, high) in enumerate(pairwise(TARGET_GAP_BORDER_M)):
        measures.append(
            Measure(
                f"{actor}_target_gap_share_{low:g}_{high:g}_m",
                f"share of lane-changing distances of {low:g} to {high:g} m",
                VEHICLE,
                f"{actor}_target_gap_bin[{index}]",
                gaps,
            )
        )
    return measures


def _lane_changers() -> list[Measure]:
    return [
        Measure(
            "background_mean_target_gap_m",
            "lane-changing distance seen in full, mean over vehicles of their means (Eq. 29)",
            VEHICLE,
            "lane_changer_target_gap_m",
            "lane_changers",
            censored="background_target_gaps_censored",
        ),
    ]


def _encounters() -> list[Measure]:
    return [
        Measure("cut_ins_per_drive", "cut-ins in front of the subject vehicle", VEHICLE, "cut_ins", "drives"),
        Measure(
            "cut_ins_pkm", "cut-ins per km", VEHICLE, "cut_ins", "subject_distance_m", PER_KM, observations="cut_ins"
        ),
        Measure("cut_in_gap_m", "gap of a cut-in", VEHICLE, "cut_in_gap_m", "cut_ins"),
        Deviation(
            "cut_in_gap_deviation_m",
            "standard deviation of that gap",
            VEHICLE,
            "cut_in_gap_m",
            "cut_ins",
            squares="cut_in_gap_squared",
        ),
        Measure(
            "cut_in_speed_difference_mps",
            "subject vehicle's speed less that of the newcomer",
            VEHICLE,
            "cut_in_speed_difference",
            "cut_ins",
        ),
        Measure("cut_outs_per_drive", "vehicles that leave the lane ahead", VEHICLE, "cut_outs", "drives"),
        Measure("overtaken_per_drive", "vehicles that pass the subject vehicle", VEHICLE, "overtaken", "drives"),
        Measure("overtaken_left_share", "share of them on its left", VEHICLE, "overtaken_left", "overtaken"),
        Measure(
            "overtaken_speed_difference_mps",
            "how much faster they are",
            VEHICLE,
            "overtaken_speed_difference",
            "overtaken",
        ),
        Measure("overtakes_per_drive", "vehicles that the subject vehicle passes", VEHICLE, "overtakes", "drives"),
        Measure(
            "overtakes_speed_difference_mps",
            "how much slower they are",
            VEHICLE,
            "overtakes_speed_difference",
            "overtakes",
        ),
    ]
