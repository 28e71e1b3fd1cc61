"""Jerk, worked out by hand."""

from collections.abc import Callable

import pytest

from jaxcalib.measures.measure import MeasureValue
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]


def speeds(*speed_mps: float) -> PerceptionFrame:
    return drive(*(instant(3.0 + 0.5 * k, Car(EGO, 1, 300.0 + 10.0 * k, speed)) for k, speed in enumerate(speed_mps)))


def test_jerk_is_the_change_of_acceleration(measure: MeasureOf):
    found = measure(speeds(20.0, 21.0, 20.5, 19.0), "subject_jerk_rms_mps3")  # 2, -1 and -3 m/s^2
    assert found.value == pytest.approx(((6.0**2 + 4.0**2) / 2.0) ** 0.5, rel=1e-5)
    assert found.num_observations == 2


def test_it_takes_three_frames(measure: MeasureOf):
    assert not measure(speeds(20.0, 21.0), "subject_jerk_rms_mps3").is_valid
