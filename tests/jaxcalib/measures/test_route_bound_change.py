"""How late vehicles merge and leave, worked out by hand."""

from collections.abc import Callable

import pytest

from jaxcalib.measures.measure import MeasureValue
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], dict[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]


def change(from_row: int, to_row: int, at_m: float, track: int = 0) -> PerceptionFrame:
    """A vehicle of 16 m/s is in another row than half a second before."""
    others = () if track == EGO else (Car(EGO, 1, at_m - 30.0, 16.0),)
    later = () if track == EGO else (Car(EGO, 1, at_m - 22.0, 16.0),)
    return drive(
        instant(2.0, Car(track, from_row, at_m - 8.0, 16.0), *others),
        instant(2.5, Car(track, to_row, at_m, 16.0), *later),
    )


@pytest.mark.parametrize(
    ("from_row", "to_row", "at_m", "merging_m", "exiting_m"),
    [
        (2, 0, 450.0, 50.0, None),  # out of the lane that ends at 500 m
        (2, 0, 305.0, None, None),  # it was not yet in that lane half a second ago
        (2, 0, 506.0, 0.0, None),  # its new lane is first seen behind the end
        (0, 2, 450.0, None, None),  # into a lane that ends: by no route
        (0, 2, 730.0, None, 120.0),  # into the lane that leads off at 850 m
        (2, 0, 730.0, 120.0, None),  # out of it, who stays on the road must
        (0, 1, 730.0, None, None),
        (2, 0, 600.0, None, None),  # between both lanes of the row
    ],
)
def test_the_way_left_is_that_to_the_end_of_the_lane(
    measure: MeasureOf, from_row: int, to_row: int, at_m: float, merging_m: float | None, exiting_m: float | None
):
    frames = change(from_row, to_row, at_m)
    for kind, way_m in (("merging", merging_m), ("exiting", exiting_m)):
        found = measure(frames, f"{kind}_way_left_m")
        assert found.is_valid == (way_m is not None)
        assert found.num_observations == (way_m is not None)
        assert measure(frames, f"{kind}_changes_per_drive").value == (way_m is not None)
        if way_m is not None:
            assert found.value == pytest.approx(way_m)
            assert measure(frames, f"{kind}_urgent_share").value == (way_m < 100.0)


def test_the_percentile_lies_in_the_class_of_the_way(measure: MeasureOf):
    # 120 m in the class from 100 to 150 m: 15 % of the way through it
    assert measure(change(0, 2, 730.0), "exiting_way_left_p15_m").value == pytest.approx(107.5)


def test_the_subject_vehicle_s_own_changes_are_no_traffic(count: Count):
    assert count(change(2, 0, 450.0, EGO))["merging_changes"] == 0.0
