"""Speed, density, volume and travel time on the road that the subject vehicle passes (Table 3, Eqs. 33-36).

Speed, density and volume follow Edie's definitions over the stretch within the sensor's range and the time of the
drive: density is the time spent by vehicles per metre of lane and second, volume the distance driven by them, speed
their ratio. The paper does not define them (its Eqs. 33-35 take them as known).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import Deviation, LeftOut, Level, Measure, Moe
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.observed_road import ObservedRoad
from jaxcalib.measures.scene import MeasureSettings, Scene
from sim_adapters.units import METRES_PER_KILOMETRE, SECONDS_PER_HOUR

VEHICLE, TRAFFIC = Level.VEHICLE, Level.TRAFFIC


class TrafficFlow(Fold):
    """Speed, density and volume over the whole route, by section and by lane."""

    num_sections: int = eqx.field(static=True)
    num_rows: int = eqx.field(static=True)

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return (
            "vehicle_frames",
            "vehicle_speed",
            "vehicle_speed_squared",
            "lane_m_frames",
            "free_vehicles",
            "free_speed",
            "free_speed_squared",
            "observed_vehicles",
            "speed_variance",
            *indexed("section_frames", self.num_sections),
            *indexed("section_speed", self.num_sections),
            *indexed("section_lane_m", self.num_sections),
            *indexed("row_frames", self.num_rows),
            *indexed("row_speed", self.num_rows),
        )

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        frame, road = scene.frame, scene.settings.road
        is_vehicle = scene.is_vehicle.astype(jnp.float32)
        speed = jnp.where(scene.is_vehicle, frame.object_speed_mps, 0.0)
        here = frame.subject_position_m
        lane_m = road.lane_m_by_section(here - frame.behind_m, here + frame.ahead_m)
        in_section = within(scene.position_m, road.section_border_m)
        in_row = frame.object_row == jnp.arange(road.num_rows)[:, None]
        return {
            "vehicle_frames": jnp.sum(is_vehicle),
            "vehicle_speed": jnp.sum(speed),
            "vehicle_speed_squared": jnp.sum(speed * speed),
            "lane_m_frames": jnp.sum(lane_m),
            **by_index("section_frames", sums_by_class(in_section, is_vehicle)),
            **by_index("section_speed", sums_by_class(in_section, speed)),
            **by_index("section_lane_m", lane_m),
            **by_index("row_frames", sums_by_class(in_row, is_vehicle)),
            **by_index("row_speed", sums_by_class(in_row, speed)),
        }

    def track_names(self) -> tuple[str, ...]:
        """Names of the sums over frames for each vehicle."""
        return ("frames", "speed", "speed_squared", "free_frames", "free_speed")

    def count_per_track(self, scene: Scene) -> dict[str, Float[Array, " object"]]:
        """A scene's part of these sums."""
        background = scene.is_background.astype(jnp.float32)
        free = (scene.is_background & scene.is_free).astype(jnp.float32)
        speed = scene.frame.object_speed_mps
        return {
            "frames": background,
            "speed": background * speed,
            "speed_squared": background * speed * speed,
            "free_frames": free,
            "free_speed": free * speed,
        }

    def settle(self, tracks: dict[str, Float[Array, " track"]]) -> dict[str, Array]:
        """Return means over vehicles: free speed, and variance of speed within the time in which each was seen."""
        seen, free = tracks["frames"] > 0, tracks["free_frames"] > 0
        mean = tracks["speed"] / jnp.maximum(tracks["frames"], 1.0)
        variance = jnp.maximum(tracks["speed_squared"] / jnp.maximum(tracks["frames"], 1.0) - mean * mean, 0.0)
        free_speed = jnp.where(free, tracks["free_speed"] / jnp.maximum(tracks["free_frames"], 1.0), 0.0)
        return {
            "observed_vehicles": jnp.sum(seen.astype(jnp.float32)),
            "speed_variance": jnp.sum(jnp.where(seen, variance, 0.0)),
            "free_vehicles": jnp.sum(free.astype(jnp.float32)),
            "free_speed": jnp.sum(free_speed),
            "free_speed_squared": jnp.sum(free_speed * free_speed),
        }


class SubjectTravel(Fold):
    """How far and how long the subject vehicle drove, in all and by section."""

    num_sections: int = eqx.field(static=True)

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return (
            "drives",
            "subject_frames",
            "subject_time_s",
            "subject_distance_m",
            "subject_acceleration_squared",
            *indexed("subject_section_frames", self.num_sections),
            *indexed("subject_section_speed", self.num_sections),
        )

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies. Distance is speed times interval: positions may be measured less well."""
        frame = scene.frame
        in_section = within(frame.subject_position_m[None], scene.settings.road.section_border_m)[:, 0]
        section = in_section.astype(jnp.float32)
        return {
            "drives": jnp.where(scene.interval_s == 0, 1.0, 0.0),
            "subject_frames": jnp.asarray(1.0),
            "subject_time_s": scene.interval_s,
            "subject_distance_m": scene.interval_s * frame.subject_speed_mps,
            "subject_acceleration_squared": frame.subject_acceleration_mps2**2,
            **by_index("subject_section_frames", section),
            **by_index("subject_section_speed", section * frame.subject_speed_mps),
        }


def _folds(settings: MeasureSettings) -> list[Fold]:
    num_sections, num_rows = settings.road.num_sections, settings.road.num_rows
    return [TrafficFlow(num_sections, num_rows), SubjectTravel(num_sections)]


def _measures(settings: MeasureSettings) -> list[Measure]:
    road = settings.road
    sections = [measure for index in range(road.num_sections) for measure in _of_section(road, index)]
    return [*_FLOW, *_SPEEDS, *sections, *(measure for row in range(road.num_rows) for measure in _of_row(row))]


_FLOW = (
    Measure(
        "traffic_speed_mps", "mean speed of all vehicles seen", TRAFFIC, "vehicle_speed", "vehicle_frames",
        left_out=LeftOut.FOLLOWS, moe=Moe.TRAFFIC_SPEED,
    ),
    Measure(
        "traffic_density_vehpkm", "vehicles per kilometre of lane", TRAFFIC, "vehicle_frames", "lane_m_frames",
        METRES_PER_KILOMETRE, observations="vehicle_frames", left_out=LeftOut.FOLLOWS, moe=Moe.TRAFFIC_DENSITY,
    ),
    Measure(
        "traffic_volume_vehph", "vehicles per hour and lane (Edie)", TRAFFIC, "vehicle_speed", "lane_m_frames",
        SECONDS_PER_HOUR, observations="vehicle_frames", left_out=LeftOut.FOLLOWS, moe=Moe.TRAFFIC_VOLUME,
    ),
    Deviation(
        "traffic_speed_deviation_mps", "standard deviation of speed over vehicles and time", TRAFFIC,
        "vehicle_speed", "vehicle_frames", squares="vehicle_speed_squared",
    ),
    Measure(
        "subject_speed_mps", "subject vehicle's distance / travel time", TRAFFIC,
        "subject_distance_m", "subject_time_s", observations="drives", moe=Moe.TRAFFIC_DYNAMICS,
    ),
    Measure(
        "subject_travel_time_s", "travel time of a drive", TRAFFIC, "subject_time_s", "drives",
        left_out=LeftOut.FOLLOWS,
    ),
)  # fmt: skip
_SPEEDS = (
    Measure(
        "free_speed_mps", "speed of vehicles with no leader near, mean over vehicles", VEHICLE,
        "free_speed", "free_vehicles",
    ),
    Deviation(
        "free_speed_deviation_mps", "standard deviation of free speed between vehicles", VEHICLE,
        "free_speed", "free_vehicles", squares="free_speed_squared",
    ),
    Measure(
        "speed_oscillation_m2ps2", "variance of a vehicle's speed while seen, mean over vehicles", VEHICLE,
        "speed_variance", "observed_vehicles",
    ),
    Measure(
        "acceleration_square_m2ps4", "mean square acceleration of background vehicles", VEHICLE,
        "acceleration_squared", "acceleration_frames", left_out=LeftOut.SINGLE_STEPS,
    ),
    Measure(
        "subject_acceleration_square_m2ps4", "mean square acceleration of the subject vehicle", VEHICLE,
        "subject_acceleration_squared", "subject_frames", left_out=LeftOut.SINGLE_STEPS,
    ),
)  # fmt: skip


def _of_section(road: ObservedRoad, index: int) -> list[Measure]:
    low, high = float(road.section_border_m[index]), float(road.section_border_m[index + 1])
    name, where = f"section_{index}", f"from {low:.0f} to {high:.0f} m"
    vehicles, speeds, lane_m = (f"section_{tally}[{index}]" for tally in ("frames", "speed", "lane_m"))
    return [
        Measure(
            f"{name}_density_vehpkm", f"density {where}", TRAFFIC, vehicles, lane_m, METRES_PER_KILOMETRE,
            observations=vehicles,
        ),
        Measure(f"{name}_speed_mps", f"speed {where}", TRAFFIC, speeds, vehicles),
        Measure(
            f"{name}_volume_vehph", f"volume {where}", TRAFFIC, speeds, lane_m, SECONDS_PER_HOUR,
            observations=vehicles, left_out=LeftOut.FOLLOWS,
        ),
        Measure(
            f"{name}_subject_speed_mps", f"subject vehicle's speed {where}", TRAFFIC,
            f"subject_section_speed[{index}]", f"subject_section_frames[{index}]", left_out=LeftOut.FOLLOWS,
        ),
        *(
            Measure(
                f"{name}_lane_changes_{side}_pkm", f"lane changes to the {side} {where}", VEHICLE,
                f"section_{side}[{index}]", f"section_distance_m[{index}]", METRES_PER_KILOMETRE,
                observations=f"section_{side}[{index}]",
            )
            for side in ("left", "right")
        ),
    ]  # fmt: skip


def _of_row(row: int) -> list[Measure]:
    return [
        Measure(
            f"row_{row}_share", "share of vehicles in this row", TRAFFIC, f"row_frames[{row}]", "vehicle_frames",
            left_out=LeftOut.FOLLOWS if row == 0 else None,  # shares add up to 1
        ),
        Measure(f"row_{row}_speed_mps", "speed in this row", TRAFFIC, f"row_speed[{row}]", f"row_frames[{row}]"),
    ]  # fmt: skip


GROUP = MeasureGroup(_measures, _folds)
