"""The fundamental diagram of each section: volume and speed of traffic, by how dense it is.

Each frame shows a section at one density, that of the vehicles on the part of it within the sensor's range. Frames are
put into classes of density, and volume and speed of a class are Edie's over all its frames: their points, class by
class, draw the diagram, and show a capacity or a jam that a mean over a drive hides.

Source: classes between levels of service, A and B, C and D, E, and F beyond capacity, at 11, 22 and 28 cars per
    kilometre and lane: Highway Capacity Manual (2000), ch. 23. Volume and speed: Edie (1963), as in `traffic_flow`.
Deviation: all vehicles count as one, and frames that see less than 100 m of a section say nothing of it: one vehicle
    on 30 m of lane would be a jam. What stretch is seen depends on the sensor, so diagrams compare only between
    sources that see as far.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import LeftOut, Level, Measure
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import MeasureSettings, Scene
from sim_adapters.units import METRES_PER_KILOMETRE, SECONDS_PER_HOUR

TRAFFIC = Level.TRAFFIC
LEVELS = {"ab": "A or B", "cd": "C or D", "e": "E", "f": "F"}
DENSITY_BORDER_VEHPKM = (11.0, 22.0, 28.0)
LEAST_SEEN_M = 100.0
PARTS = ("lane_m", "vehicles", "speed")


class FundamentalDiagram(Fold):
    """Metres of lane, vehicles and their speeds, by section and class of density."""

    num_sections: int = eqx.field(static=True)

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return tuple(
            name for level in LEVELS for part in PARTS for name in indexed(f"level_{level}_{part}", self.num_sections)
        )

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        frame, road = scene.frame, scene.settings.road
        here_m = frame.subject_position_m
        rear_m, front_m = here_m - frame.behind_m, here_m + frame.ahead_m
        lane_m = road.lane_m_by_section(rear_m, front_m)
        in_section = within(scene.position_m, road.section_border_m)
        vehicles = sums_by_class(in_section, scene.is_vehicle.astype(jnp.float32))
        speed = sums_by_class(in_section, jnp.where(scene.is_vehicle, frame.object_speed_mps, 0.0))
        is_seen = jnp.diff(jnp.clip(road.section_border_m, rear_m, front_m)) >= LEAST_SEEN_M
        density = METRES_PER_KILOMETRE * vehicles / jnp.maximum(lane_m, 1.0)
        level = jnp.searchsorted(jnp.asarray(DENSITY_BORDER_VEHPKM), density, side="right")
        counted: dict[str, Array] = {}
        for index, name in enumerate(LEVELS):
            is_such = is_seen & (level == index)
            for part, values in zip(PARTS, (lane_m, vehicles, speed), strict=True):
                counted |= by_index(f"level_{name}_{part}", jnp.where(is_such, values, 0.0))
        return counted


def _measures(settings: MeasureSettings) -> list[Measure]:
    measures: list[Measure] = []
    for section in range(settings.road.num_sections):
        low, high = (float(border) for border in settings.road.section_border_m[section : section + 2])
        for level, title in LEVELS.items():
            name = f"section_{section}_level_{level}"
            where = f"from {low:.0f} to {high:.0f} m at level of service {title}"
            lane_m, vehicles, speed = (f"level_{level}_{part}[{section}]" for part in PARTS)
            measures += [
                Measure(
                    f"{name}_volume_vehph", f"volume {where}, per lane", TRAFFIC, speed, lane_m, SECONDS_PER_HOUR,
                    observations=vehicles, left_out=LeftOut.BIN,
                ),
                Measure(f"{name}_speed_mps", f"speed {where}", TRAFFIC, speed, vehicles, left_out=LeftOut.BIN),
            ]  # fmt: skip
    return measures


GROUP = MeasureGroup(_measures, lambda settings: [FundamentalDiagram(settings.road.num_sections)])
