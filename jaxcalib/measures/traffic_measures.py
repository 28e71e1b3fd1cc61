"""Measures of the traffic flow and of speeds (Table 3, Eqs. 33-36), on the whole route, by section and by row."""

from jaxcalib.measures.measure import Deviation, Level, Measure
from jaxcalib.measures.observed_road import ObservedRoad
from sim_adapters.units import METRES_PER_KILOMETRE, SECONDS_PER_HOUR

VEHICLE, TRAFFIC = Level.VEHICLE, Level.TRAFFIC
PER_KM = METRES_PER_KILOMETRE


def traffic_measures(road: ObservedRoad) -> list[Measure]:
    """Return them for a road."""
    return [*_whole_route(), *_by_section(road), *_by_row(road)]


def _whole_route() -> list[Measure]:
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
