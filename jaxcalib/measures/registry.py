"""Every measure of the library, by name (Tables 2 and 3)."""

from jaxcalib.measures.following_measures import following_measures
from jaxcalib.measures.lane_change_measures import lane_change_measures
from jaxcalib.measures.measure import Measure
from jaxcalib.measures.scene import MeasureSettings
from jaxcalib.measures.traffic_measures import traffic_measures


def all_measures(settings: MeasureSettings) -> dict[str, Measure]:
    """Return the measures for a road and a sensor, by name."""
    lane_changes = lane_change_measures(settings.num_target_gap_classes)
    measures = [*traffic_measures(settings.road), *following_measures(), *lane_changes]
    return {measure.name: measure for measure in measures}
