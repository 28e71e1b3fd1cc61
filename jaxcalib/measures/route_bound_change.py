"""How late vehicles make the changes that their route asks for: the way that is left to them.

A vehicle that leaves a lane which ends merges; one that changes into a lane which only leads off the road is exiting.
The urgency of such a change is the way left to where that lane ends or parts from the carriageway, in the first frame
in the new lane: who changes late has little of it. Further than a kilometre before the end a change counts as one of
choice: there stands the first sign of an exit (Germany, RWBA 2000).

Source: urgency of lane changes, Xyntarakis et al. (2017), FHWA's framework for validating simulations by trajectories.
Deviation: the route of a vehicle is not seen, its lanes are. Changes in time for an exit whose lane has not yet begun
    look like others; so does leaving a lane that will end, by who would have left it anyway.
"""

import jax.numpy as jnp
from jaxtyping import Array

from jaxcalib.measures.fold import Fold, by_index, indexed, sums_by_class, within
from jaxcalib.measures.measure import LeftOut, Level, Measure, Percentile
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import MeasureSettings, Scene

VEHICLE = Level.VEHICLE
KINDS = {"merging": "out of a lane that ends", "exiting": "into a lane that leads off the road"}
WAY_BORDER_M = (0.0, 25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 400.0, 600.0, 800.0, 1000.0)


class RouteBoundChanges(Fold):
    """Changes of background vehicles out of lanes that end and into lanes that lead off, by the way left."""

    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return tuple(
            name
            for kind in KINDS
            for name in (
                f"{kind}_changes",
                f"{kind}_urgent",
                f"{kind}_way_m",
                *indexed(f"{kind}_way_bin", len(WAY_BORDER_M) - 1),
            )
        )

    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies."""
        ending = scene.settings.road.ending
        here_m = scene.position_m
        before_m = here_m - scene.interval_s * scene.frame.object_speed_mps
        changes = scene.is_background & scene.changes_lane
        left_end_m = ending.end_m_at(scene.previous_row, before_m)
        new_end_m = ending.end_m_at(scene.frame.object_row, here_m, only_leading_off=True)
        counted: dict[str, Array] = {}
        for kind, end_m in (("merging", left_end_m), ("exiting", new_end_m)):
            way_m = jnp.maximum(end_m - here_m, 0.0)
            is_bound = changes & (way_m < WAY_BORDER_M[-1])
            number = is_bound.astype(jnp.float32)
            counted[f"{kind}_changes"] = jnp.sum(number)
            is_urgent = is_bound & (way_m < scene.settings.limits.urgent_way_m)
            counted[f"{kind}_urgent"] = jnp.sum(is_urgent.astype(jnp.float32))
            counted[f"{kind}_way_m"] = jnp.sum(jnp.where(is_bound, way_m, 0.0))
            in_bin = within(jnp.where(is_bound, way_m, -1.0), jnp.asarray(WAY_BORDER_M))
            counted |= by_index(f"{kind}_way_bin", sums_by_class(in_bin, number))
        return counted


def _measures(settings: MeasureSettings) -> list[Measure]:
    urgent_m = float(settings.limits.urgent_way_m)
    measures: list[Measure] = []
    for kind, what in KINDS.items():
        changes = f"{kind}_changes"
        measures += [
            Measure(
                f"{kind}_way_left_m", f"way left to its end at a change {what} (urgency)", VEHICLE,
                f"{kind}_way_m", changes, left_out=LeftOut.FEW,
            ),
            Measure(
                f"{kind}_urgent_share", f"share of changes {what} with less than {urgent_m:g} m left", VEHICLE,
                f"{kind}_urgent", changes, left_out=LeftOut.FEW,
            ),
            Percentile(
                f"{kind}_way_left_p15_m", f"15% of changes {what} leave less way than that", VEHICLE,
                f"{kind}_way_bin", changes, borders=WAY_BORDER_M, share=0.15,
            ),
            Measure(
                f"{kind}_changes_per_drive", f"changes {what} seen in a drive", VEHICLE, changes, "drives",
                observations=changes, left_out=LeftOut.FEW,
            ),
        ]  # fmt: skip
    return measures


GROUP = MeasureGroup(_measures, lambda settings: [RouteBoundChanges()])
