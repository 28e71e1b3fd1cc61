"""Tracks that no vehicle can have made: left out and counted where they are few, refused where they are many."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.field.physics.impossible_tracks import impossible_rows
from jaxcalib.field.physics.motion import DriveMotion
from tests.jaxcalib.field.physics.motions import drive, with_track


def with_echo(motion: DriveMotion, relative_y_m: float) -> DriveMotion:
    """Something stands beside the road, or on it, and is passed."""
    place_m = float(np.median(motion.position_m))
    relative_x_m = place_m - motion.position_m
    rows = np.flatnonzero(np.abs(relative_x_m) < 80.0)
    return with_track(motion, rows, relative_x_m[rows], relative_y_m, 0.0)


def with_oncoming(motion: DriveMotion) -> DriveMotion:
    rows = np.arange(400, 450)
    closing_m = np.cumsum(motion.speed_mps[rows] + 25.0) * 0.1
    return with_track(motion, rows, 120.0 - closing_m, 9.0, 25.0)


def with_double(motion: DriveMotion) -> DriveMotion:
    rows = np.flatnonzero(motion.vehicle == 3)
    at = np.searchsorted(motion.time_s, motion.object_time_s[rows] - 1e-6)
    x_m, speed_mps = motion.relative_x_m[rows] + 0.8, motion.object_speed_mps[rows]
    return with_track(motion, at, x_m, float(motion.relative_y_m[rows[0]]), speed_mps)


def with_itself(motion: DriveMotion) -> DriveMotion:
    rows = np.arange(100, 300)
    return with_track(motion, rows, 0.1, 0.0, motion.speed_mps[rows])


KINDS = {
    "subject_itself": with_itself,
    "doubled": with_double,
    "oncoming": with_oncoming,
    "standing": lambda motion: with_echo(motion, 3.5),
}


def test_the_traffic_itself_stays():
    for seed in range(4):
        assert not impossible_rows(drive(seed)).any.any()


@pytest.mark.parametrize("kind", KINDS)
def test_what_no_vehicle_can_be_is_left_out_and_counted(kind: str):
    motion = drive(5)
    spoilt = KINDS[kind](motion)
    found = impossible_rows(spoilt)
    added = len(spoilt.vehicle) - len(motion.vehicle)
    assert {name: int(rows.sum()) for name, rows in found.by_kind.items() if rows.any()} == {kind: added}
    (told,) = found.contradictions(spoilt)
    assert told.kind == kind
    assert not told.is_refused
    assert f"{added} of {len(spoilt.vehicle)} rows" in str(told)
    assert len(spoilt.without(found.any).vehicle) == len(motion.vehicle)


def test_something_that_stands_where_nobody_drives_may_be_real():
    assert not impossible_rows(with_echo(drive(5), 12.0)).any.any()


def test_a_number_for_nothing_is_left_out_and_many_are_refused():
    motion = drive(6)
    few, many = motion.relative_x_m.copy(), motion.relative_x_m.copy()
    few[::50], many[::6] = 9999.0, 9999.0
    for values, is_refused in ((few, False), (many, True)):
        spoilt = replace(motion, relative_x_m=values)
        (told,) = impossible_rows(spoilt).contradictions(spoilt)
        assert (told.kind, told.is_refused) == ("sentinel", is_refused)


def test_no_objects_are_no_contradiction():
    motion = drive(1).without(np.ones(len(drive(1).vehicle), bool))
    assert len(impossible_rows(motion).any) == 0
