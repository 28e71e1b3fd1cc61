"""Every measure of the library, by name (Tables 2 and 3)."""

from itertools import pairwise

from jaxcalib.measures.car_following import HEADWAY_BORDER_S, SPEED_BORDER_MPS
from jaxcalib.measures.lane_change import TARGET_GAP_BORDER_M
from jaxcalib.measures.measure import Deviation, Level, Measure, Percentile
from jaxcalib.measures.observed_road import ObservedRoad
from sim_adapters.units import METRES_PER_KILOMETRE, SECONDS_PER_HOUR

VEHICLE, TRAFFIC = Level.VEHICLE, Level.TRAFFIC
PER_KM = METRES_PER_KILOMETRE


def all_measures(road: ObservedRoad) -> dict[str, Measure]:
    """Return the measures for a road, by name."""
    measures = [*_traffic(), *_following("subject"), *_following("background"), *_spacing_by_speed()]
    measures += [*_lane_changes("subject"), *_lane_changes("background"), *_lane_changers(), *_encounters()]
    measures += [*_by_section(road), *_by_row(road)]
    return {measure.name: measure for measure in measures}


def _traffic() -> list[Measure]:
    return [
        Measure("traffic_speed_mps", "mean speed of all vehicles seen", TRAFFIC, "vehicle_speed", "vehicle_frames"),
        Measure(
            "traffic_density_vehpkm",
            "vehicles per kilometre of lane",
            TRAFFIC,
            "vehicle_frames",
            "lane_m_frames",
            PER_KM,
            observations="vehicle_frames",
        ),
        Measure(
            "traffic_volume_vehph",
            "vehicles per hour and lane (Edie)",
            TRAFFIC,
            "vehicle_speed",
            "lane_m_frames",
            SECONDS_PER_HOUR,
            observations="vehicle_frames",
        ),
        Deviation(
            "traffic_speed_deviation_mps",
            "standard deviation of speed over vehicles and time",
            TRAFFIC,
            "vehicle_speed",
            "vehicle_frames",
            squares="vehicle_speed_squared",
        ),
        Measure(
            "subject_speed_mps",
            "subject vehicle's distance / travel time",
            TRAFFIC,
            "subject_distance_m",
            "subject_time_s",
            observations="drives",
        ),
        Measure("subject_travel_time_s", "travel time of a drive", TRAFFIC, "subject_time_s", "drives"),
        Measure(
            "free_speed_mps",
            "speed of vehicles with no leader near, mean over vehicles",
            VEHICLE,
            "free_speed",
            "free_vehicles",
        ),
        Deviation(
            "free_speed_deviation_mps",
            "standard deviation of free speed between vehicles",
            VEHICLE,
            "free_speed",
            "free_vehicles",
            squares="free_speed_squared",
        ),
        Measure(
            "speed_oscillation_m2ps2",
            "variance of a vehicle's speed while seen, mean over vehicles",
            VEHICLE,
            "speed_variance",
            "observed_vehicles",
        ),
        Measure(
            "acceleration_square_m2ps4",
            "mean square acceleration of background vehicles",
            VEHICLE,
            "acceleration_squared",
            "acceleration_frames",
        ),
        Measure(
            "subject_acceleration_square_m2ps4",
            "mean square acceleration of the subject vehicle",
            VEHICLE,
            "subject_acceleration_squared",
            "subject_frames",
        ),
    ]


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
            "lane-changing distance: rear of new leader to front of new follower, mean over changes",
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
            "lane-changing distance, mean over vehicles of their means (Eq. 29)",
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


def _by_section(road: ObservedRoad) -> list[Measure]:
    measures = []
    for index in range(road.num_sections):
        low, high = float(road.section_border_m[index]), float(road.section_border_m[index + 1])
        where = f"from {low:.0f} to {high:.0f} m"
        measures += [
            Measure(
                f"section_{index}_density_vehpkm",
                f"density {where}",
                TRAFFIC,
                f"section_frames[{index}]",
                f"section_lane_m[{index}]",
                PER_KM,
                observations=f"section_frames[{index}]",
            ),
            Measure(
                f"section_{index}_speed_mps",
                f"speed {where}",
                TRAFFIC,
                f"section_speed[{index}]",
                f"section_frames[{index}]",
            ),
            Measure(
                f"section_{index}_volume_vehph",
                f"volume {where}",
                TRAFFIC,
                f"section_speed[{index}]",
                f"section_lane_m[{index}]",
                SECONDS_PER_HOUR,
                observations=f"section_frames[{index}]",
            ),
            Measure(
                f"section_{index}_subject_speed_mps",
                f"subject vehicle's speed {where}",
                TRAFFIC,
                f"subject_section_speed[{index}]",
                f"subject_section_frames[{index}]",
            ),
        ]
        measures += [
            Measure(
                f"section_{index}_lane_changes_{side}_pkm",
                f"lane changes to the {side} {where}",
                VEHICLE,
                f"section_{side}[{index}]",
                f"section_distance_m[{index}]",
                PER_KM,
                observations=f"section_{side}[{index}]",
            )
            for side in ("left", "right")
        ]
    return measures


def _by_row(road: ObservedRoad) -> list[Measure]:
    measures = []
    for row in range(road.num_rows):
        measures += [
            Measure(
                f"row_{row}_share", "share of vehicles in this row", TRAFFIC, f"row_frames[{row}]", "vehicle_frames"
            ),
            Measure(f"row_{row}_speed_mps", "speed in this row", TRAFFIC, f"row_speed[{row}]", f"row_frames[{row}]"),
        ]
    return measures
