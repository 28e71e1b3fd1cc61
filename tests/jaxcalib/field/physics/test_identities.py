"""Identities between the quantities of a log: right ones pass, each planted fault is found with its size."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.field.physics.motion import DriveMotion
from tests.jaxcalib.field.physics.motions import drive, judged, thinned, with_relative_speeds

NUM_DRIVES = 4
Spoil = Callable[[DriveMotion], DriveMotion]


def late(motion: DriveMotion, late_s: float) -> DriveMotion:
    time_s = motion.object_time_s + late_s
    inside = (time_s >= motion.time_s[0]) & (time_s <= motion.time_s[-1])
    return replace(motion, object_time_s=time_s).without(~inside)


# what is spoilt, the kind that it is, whether it is refused, words
FAULTS: dict[str, tuple[Spoil, str, bool, str]] = {
    "subject in m/s": (lambda m: replace(m, speed_mps=m.speed_mps / 3.6), "speed_scale", True, "m/s?"),
    "subject in mph": (lambda m: replace(m, speed_mps=m.speed_mps / 1.609344), "speed_scale", True, "mph?"),
    "subject 3 % slow": (lambda m: replace(m, speed_mps=0.97 * m.speed_mps), "speed_scale", False, "1.03"),
    "subject late": (
        lambda m: replace(m, speed_mps=np.interp(m.time_s - 0.5, m.time_s, m.speed_mps)),
        "speed_delay", False, "s after the places",
    ),
    "backwards": (lambda m: replace(m, position_m=m.position_m[::-1]), "backwards", True, "against the direction"),
    "acceleration's sign": (
        lambda m: replace(m, acceleration_mps2=-m.acceleration_mps2), "acceleration", True, "opposite sign",
    ),
    "acceleration in g": (
        lambda m: replace(m, acceleration_mps2=m.acceleration_mps2 / 9.80665), "acceleration", True, "g?",
    ),
    "yaw rate's sign": (lambda m: replace(m, yaw_rate_radps=-m.yaw_rate_radps), "yaw_rate", True, "opposite sign"),
    "yaw rate in degrees": (
        lambda m: replace(m, yaw_rate_radps=np.degrees(m.yaw_rate_radps)), "yaw_rate", True, "degrees?",
    ),
    "1 m to the right": (
        lambda m: replace(m, lateral_m=m.lateral_m - 1.0), "lateral_offset", False, "1.0 m to the right",
    ),
    "2.5 m to the left": (
        lambda m: replace(m, lateral_m=m.lateral_m + 2.5), "lateral_offset", True, "2.5 m to the left",
    ),
    "objects in m/s": (
        lambda m: replace(m, object_speed_mps=m.object_speed_mps / 3.6), "object_speed_unit", True, "m/s?",
    ),
    "relative speeds": (with_relative_speeds, "relative_speeds", True, "relative to the subject"),
    "objects 3 % slow": (
        lambda m: replace(m, object_speed_mps=0.97 * m.object_speed_mps), "object_speed_scale", False, "1.03",
    ),
    "clock 18 s late": (lambda m: late(m, 18.0), "clock_offset", True, "18.0 s late"),
    "clock 0.3 s early": (lambda m: late(m, -0.3), "clock_offset", False, "s early"),
    "distances' sign": (lambda m: replace(m, relative_x_m=-m.relative_x_m), "distance_sign", True, "opposite sign"),
    "distances in feet": (lambda m: replace(m, relative_x_m=m.relative_x_m / 0.3048), "distance_unit", True, "feet"),
    "distances 3 % short": (lambda m: replace(m, relative_x_m=0.97 * m.relative_x_m), "distance_scale", False, "0.9"),
}  # fmt: skip


@pytest.mark.parametrize("sampling", [1, 5, 10])
def test_what_is_right_is_believed(sampling: int):
    """At 10, 2 and 1 Hz."""
    motions = [thinned(drive(seed), sampling) for seed in range(NUM_DRIVES)]
    assert judged(motions) == []


@pytest.mark.parametrize("number", [1, NUM_DRIVES], ids=["one drive", "all drives"])
@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_with_its_size_and_nothing_else(fault: str, number: int):
    spoil, kind, is_refused, words = FAULTS[fault]
    motions = [spoil(drive(seed)) if seed < number else drive(seed) for seed in range(NUM_DRIVES)]
    found = judged(motions)
    assert [(one.kind, one.is_refused) for one in found] == [(kind, is_refused)]
    assert words in str(found[0])
    if is_refused:
        assert found[0].drives == tuple(motion.id for motion in motions[:number])


def test_lane_changes_on_a_road_that_hardly_bends_contradict_nothing():
    """One bend, which the gyroscope's filter flattens to nothing, and lane changes elsewhere."""
    random, motions = np.random.default_rng(3), []
    for seed in range(NUM_DRIVES):
        motion = drive(seed)
        number = len(motion.time_s)
        bend = 0.2 * np.clip((np.arange(number) - 0.5 * number) / 40.0, 0.0, 1.0)
        turning = 0.02 * np.sin(np.arange(number) / 6.0) * (random.uniform(size=number) < 0.3)
        motions.append(replace(motion, heading_rad=bend, yaw_rate_radps=turning))
    assert judged(motions) == []


def test_objects_of_another_drive_are_no_objects_of_this():
    motion, other = drive(3), drive(4)
    columns = ("object_time_s", "vehicle", "relative_x_m", "relative_y_m", "object_speed_mps")
    foreign = replace(motion, **{name: getattr(other, name) for name in columns})
    assert "foreign_objects" in [one.kind for one in judged([foreign, drive(5)])]


def test_one_recording_is_no_two_drives():
    again = replace(drive(1), id="again")
    assert [(one.kind, one.is_refused) for one in judged([drive(1), drive(2), again])] == [("same_recording", False)]
    held_out = replace(again, role="held_out")
    (found,) = judged([drive(1), drive(2), held_out])
    assert found.is_refused
    assert "the same recording as drive d01, which has the other role" in str(found)


def test_a_limit_of_another_unit_is_told():
    fast = drive(0)
    limit_mps = np.full(len(fast.time_s), 1.1 * float(fast.speed_mps.max()))
    assert judged([replace(fast, speed_limit_mps=limit_mps)]) == []
    (found,) = judged([replace(fast, speed_limit_mps=limit_mps / 3.6)])
    assert (found.kind, found.is_refused) == ("speed_limit", False)
    assert "another unit" in found.words
