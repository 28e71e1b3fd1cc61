"""Every measure of the library (Tables 2 and 3), and every fold that counts for them."""

import jax.numpy as jnp

from jaxcalib.case.safety_limits import USUAL_LIMITS, SafetyLimits
from jaxcalib.measures import (
    car_following,
    cut_in,
    encounters,
    encroachment,
    fundamental_diagram,
    jerk,
    lane_change,
    overtaking,
    route_bound_change,
    safety,
    traffic_flow,
)
from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import Measure, Moe
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.observed_road import EndingRows, ObservedRoad
from jaxcalib.measures.scene import MeasureSettings

# in this order in results, in the objective and in the vector of tallies
GROUPS: tuple[MeasureGroup, ...] = (
    traffic_flow.GROUP,
    car_following.GROUP,
    lane_change.GROUP,
    cut_in.GROUP,
    overtaking.GROUP,
    safety.GROUP,
    encroachment.GROUP,
    jerk.GROUP,
    encounters.GROUP,
    route_bound_change.GROUP,
    fundamental_diagram.GROUP,
)


def all_measures(settings: MeasureSettings) -> dict[str, Measure]:
    """The measures for a road and a sensor, by name."""
    return {measure.name: measure for group in GROUPS for measure in group.measures(settings)}


def all_folds(settings: MeasureSettings) -> tuple[Fold, ...]:
    """What is counted for them."""
    return tuple(fold for group in GROUPS for fold in group.folds(settings))


def judged_measures() -> tuple[str, ...]:
    """Names of the measures that give the MoEs, in the order of these; the same on every road."""
    by_moe = {measure.moe: name for name, measure in all_measures(_any_settings()).items()}
    return tuple(by_moe[moe] for moe in Moe)


def safety_measures() -> tuple[str, ...]:
    """Names of the measures of how near traffic comes to a crash, and how late it changes; the same on every road."""
    settings = _any_settings()
    groups = (safety.GROUP, encroachment.GROUP, route_bound_change.GROUP)
    return tuple(measure.name for group in groups for measure in group.measures(settings))


def _any_settings() -> MeasureSettings:
    none, zero = jnp.zeros(0), jnp.zeros(())
    ending = EndingRows(none, none, none, none)
    road = ObservedRoad(section_border_m=jnp.zeros(1), knot_m=none, lane_m=none, lateral_order=none, ending=ending)
    limits = SafetyLimits(*(jnp.asarray(limit) for limit in USUAL_LIMITS))
    return MeasureSettings(road, zero, zero, zero, limits, num_tracks=1, num_target_gap_classes=1)
