"""Speed, density, volume and travel time by Edie's definitions, worked out by hand."""

from collections.abc import Callable

import numpy as np
import pytest

from jaxcalib.measures.measure import MeasureValue
from jaxcalib.measures.observed_road import ObservedRoad
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], dict[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]

INTERVAL_S = 0.5
# The sensors see from 60 m behind to 100 m ahead: 290 to 450 m, of which 10 m have two lanes and 150 m three.
LANE_M = [(10 * 2 + 100 * 3, 50 * 3), (100 * 3, 60 * 3), (90 * 3, 70 * 3)]  # before and behind 400 m, in each frame


def along_the_auxiliary_lane() -> PerceptionFrame:
    return drive(
        instant(20.0, Car(EGO, 0, 350.0, 20.0), Car(0, 1, 395.0, 24.0), Car(1, 2, 420.0, 12.0), acceleration_mps2=1.0),
        instant(20.5, Car(EGO, 0, 360.0, 20.0), Car(0, 1, 407.0, 24.0), Car(1, 2, 426.0, 13.0), acceleration_mps2=-2.0),
        instant(21.0, Car(EGO, 0, 370.0, 19.0), Car(0, 1, 419.0, 23.0), acceleration_mps2=-1.0),
    )


def test_density_volume_and_speed(measure: MeasureOf):
    frames = along_the_auxiliary_lane()
    area_m_s = np.sum(LANE_M) * INTERVAL_S
    time_s, distance_m = 8 * INTERVAL_S, (20 + 24 + 12 + 20 + 24 + 13 + 19 + 23) * INTERVAL_S
    density = measure(frames, "traffic_density_vehpkm")
    assert density.value == pytest.approx(1000 * time_s / area_m_s)
    assert density.num_observations == 8
    assert measure(frames, "traffic_volume_vehph").value == pytest.approx(3600 * distance_m / area_m_s)
    assert measure(frames, "traffic_speed_mps").value == pytest.approx(distance_m / time_s)


def test_volume_is_density_times_speed(measure: MeasureOf):
    frames = along_the_auxiliary_lane()
    for prefix in ("traffic", "section_0", "section_1"):
        density, speed, volume = (
            measure(frames, f"{prefix}_{name}").value for name in ("density_vehpkm", "speed_mps", "volume_vehph")
        )
        assert volume == pytest.approx(density * speed * 3.6, rel=1e-5)


def test_sections(count: Count, measure: MeasureOf):
    frames = along_the_auxiliary_lane()
    tallies = count(frames)
    assert (tallies["section_lane_m[0]"], tallies["section_lane_m[1]"]) == pytest.approx(np.sum(LANE_M, axis=0))
    assert (tallies["section_frames[0]"], tallies["section_frames[1]"]) == (4, 4)
    assert measure(frames, "section_0_speed_mps").value == pytest.approx((20 + 24 + 20 + 19) / 4)
    assert measure(frames, "section_1_speed_mps").value == pytest.approx((12 + 24 + 13 + 23) / 4)
    assert measure(frames, "section_0_subject_speed_mps").value == pytest.approx((20 + 20 + 19) / 3)
    assert measure(frames, "section_1_subject_speed_mps").reason == "never observed"


def test_rows(measure: MeasureOf):
    frames = along_the_auxiliary_lane()
    assert [measure(frames, f"row_{row}_share").value for row in range(3)] == pytest.approx([3 / 8, 3 / 8, 2 / 8])
    assert measure(frames, "row_2_speed_mps").value == pytest.approx(12.5)


def test_only_road_that_is_there_is_observed(count: Count):
    begin, end = instant(0.0, Car(EGO, 0, 20.0, 20.0)), instant(0.0, Car(EGO, 0, 950.0, 20.0))
    assert count(drive(begin))["lane_m_frames"] == pytest.approx(120 * 2)
    assert count(drive(end))["lane_m_frames"] == pytest.approx((1000 - 890) * 2)


def test_metres_of_lane_by_numerical_integration(road: ObservedRoad):
    step_m = 0.01
    place = np.arange(-100.0, 1100.0, step_m) + step_m / 2
    lanes = np.where((place < 0) | (place > 1000), 0, np.where((place > 300) & (place < 500), 3, 2))
    for rear, front in [(-60.0, 100.0), (250.0, 410.0), (290.0, 700.0), (930.0, 1090.0)]:
        for section, (low, high) in enumerate([(0, 400), (400, 1000)]):
            inside = (place > max(rear, low)) & (place < min(front, high))
            expected = np.sum(lanes[inside]) * step_m
            assert float(road.lane_m_by_section(rear, front)[section]) == pytest.approx(expected, abs=0.1)


def test_travel_time_and_speed_of_the_subject_vehicle(measure: MeasureOf, count: Count):
    frames = along_the_auxiliary_lane()
    assert measure(frames, "subject_travel_time_s").value == pytest.approx(1.0)
    assert count(frames)["subject_distance_m"] == pytest.approx(0.5 * 20 + 0.5 * 19)
    speed = measure(frames, "subject_speed_mps")
    assert (speed.value, speed.num_observations) == (pytest.approx(19.5), 1)
    assert measure(frames, "subject_acceleration_square_m2ps4").value == pytest.approx((1 + 4 + 1) / 3)


def test_speed_deviation_and_oscillation_are_those_of_numpy(measure: MeasureOf):
    frames = along_the_auxiliary_lane()
    all_speeds = [20, 24, 12, 20, 24, 13, 19, 23]
    deviation = measure(frames, "traffic_speed_deviation_mps")
    assert deviation.value == pytest.approx(np.std(all_speeds, ddof=1), rel=1e-5)
    oscillation = measure(frames, "speed_oscillation_m2ps2")
    assert oscillation.value == pytest.approx(np.mean([np.var([24, 24, 23]), np.var([12, 13])]), rel=1e-4)
    assert oscillation.num_observations == 2


def test_free_speed_is_a_mean_over_vehicles(measure: MeasureOf):
    """The subject vehicle does not count; 0 is free in both frames, 1 only while 6 s of road ahead of it are seen."""
    frames = drive(
        instant(0.0, Car(EGO, 0, 100.0, 5.0), Car(0, 0, 120.0, 9.0), Car(1, 1, 130.0, 11.5)),
        instant(0.5, Car(EGO, 0, 102.5, 5.0), Car(0, 0, 125.0, 12.0), Car(1, 1, 136.0, 12.0)),
    )
    free = measure(frames, "free_speed_mps")
    assert (free.value, free.num_observations) == (pytest.approx((10.5 + 11.5) / 2), 2)
    deviation = measure(frames, "free_speed_deviation_mps").value
    assert deviation == pytest.approx(np.std([10.5, 11.5], ddof=1), rel=1e-3)
