"""Speed, density, volume and travel time on the road that the subject vehicle passes (Table 3, Eqs. 33-36).

Speed, density and volume follow Edie's definitions over the stretch within the sensor's range and the time of the
drive: density is the time spent by vehicles per metre of lane and second, volume the distance driven by them, speed
their ratio. The paper does not define them (its Eqs. 33-35 take them as known).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.scene import Scene


class TrafficFlow(Fold):
    """Speed, density and volume over the whole route, by section and by lane."""

    num_sections: int = eqx.field(static=True)
    num_rows: int = eqx.field(static=True)

    def names(self) -> tuple[str, ...]:
        """Return the names of the tallies."""
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
        """Return what a scene adds."""
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
        """Return what is summed for each vehicle."""
        return ("frames", "speed", "speed_squared", "free_frames", "free_speed")

    def count_per_track(self, scene: Scene) -> dict[str, Float[Array, " object"]]:
        """Return what a scene adds for each vehicle."""
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
        """Return the names of the tallies."""
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
        """Return what a scene adds. Distance is speed times interval: positions may be measured less well."""
        frame = scene.frame
        one = jnp.asarray(1.0)
        in_section = within(frame.subject_position_m[None], scene.settings.road.section_border_m)[:, 0]
        section = in_section.astype(jnp.float32)
        return {
            "drives": jnp.where(scene.interval_s == 0, 1.0, 0.0),
            "subject_frames": one,
            "subject_time_s": scene.interval_s,
            "subject_distance_m": scene.interval_s * frame.subject_speed_mps,
            "subject_acceleration_squared": frame.subject_acceleration_mps2**2,
            **by_index("subject_section_frames", section),
            **by_index("subject_section_speed", section * frame.subject_speed_mps),
        }
