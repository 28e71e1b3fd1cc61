"""The shared cases read without an error, and what comes out moves as vehicles do."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from jaxcalib.case.case import read_case
from jaxcalib.field.field_log import DriveLog, read_drive
from jaxcalib.field.route_geometry import RouteGeometry, build_route_geometry
from sim_adapters.scenario.road_builder import RowMap

SAMPLING_S = 0.1
ALL_DRIVES, SOME_DRIVES = 99, 2


def neighbouring_rows(geometry: RouteGeometry) -> set[tuple[int, int]]:
    """Return pairs of rows that lie side by side somewhere."""
    pairs = {(-1, -1)}
    for rows in geometry.row_of_lane:
        pairs |= {(int(a), int(b)) for a, b in pairwise(rows) if b >= 0}
    return pairs | {(b, a) for a, b in pairs}


def check_subject(log: DriveLog) -> None:
    subject = log.subject
    step_m, step_s = np.diff(subject.position_m), np.diff(subject.time_s)
    mean_speed = (subject.speed_mps[1:] + subject.speed_mps[:-1]) / 2
    assert np.all(step_m > -0.01)
    # Positions are rounded to 1e-10 rad (0.6 mm) and lanes differ by centimetres at the ends of edges.
    np.testing.assert_allclose(step_m, mean_speed * step_s, atol=0.11)
    assert np.all(np.abs(subject.lateral_m) <= 1.875 + 0.5)


def check_objects(log: DriveLog, geometry: RouteGeometry, error_m: float) -> None:
    objects, subject = log.objects, log.subject
    order = np.lexsort((objects.instant, objects.track))
    track, instant, row = objects.track[order], objects.instant[order], objects.row[order]
    position = subject.position_m[instant] + objects.offset_m[order]
    close = (np.diff(track) == 0) & (np.diff(instant) == 1)
    speed = objects.speed_mps[order]
    step = np.diff(position) - (speed[1:] + speed[:-1]) / 2 * np.diff(subject.time_s[instant])
    assert np.abs(step[close]).max() <= error_m
    changes = {(int(a), int(b)) for a, b in zip(row[:-1][close], row[1:][close], strict=True) if a != b}
    assert changes <= neighbouring_rows(geometry)
    assert close.sum() > 0.9 * len(track)
    assert len(set(zip(objects.instant, objects.track, strict=True))) == len(objects.instant)
    assert np.nanmax(np.abs(objects.lateral_m)) <= 1.875 + 0.5


@pytest.mark.parametrize(
    ("name", "num_drives", "error_m"),
    [
        # Rounding moves an object by up to 0.02 m per step; at the ends of edges lanes differ by up to 0.07 m from the
        # axis, which takes the longest way from edge to edge.
        ("corridor", ALL_DRIVES, 0.11),
        ("expressway", ALL_DRIVES, 0.11),
        ("practice/01", SOME_DRIVES, 0.11),
        ("practice/06", SOME_DRIVES, 5 * 2**0.5 * 0.262 + 0.1),  # noise of 0.26 m in distance, of m/s in speed
        ("practice/10", SOME_DRIVES, 0.11),  # lost detections
        ("practice/17", SOME_DRIVES, 0.15),  # distances 5 % too far
        ("practice/22", SOME_DRIVES, 0.11),  # lane changes that take time
        ("practice/25", SOME_DRIVES, 0.15),  # reports 0.7 s late
    ],
)
def test_a_case(shared_cases: Path, row_map_of: Callable[[Path], RowMap], name: str, num_drives: int, error_m: float):
    case, row_map = read_case(shared_cases / name), row_map_of(shared_cases / name)
    geometry = build_route_geometry(row_map)
    for drive in case.drives[:num_drives]:
        log = read_drive(case, drive, row_map, geometry)
        counts = log.counts
        check_subject(log)
        check_objects(log, geometry, error_m)
        assert counts.subject_rows_without_place == counts.rows_without_subject == counts.rows_without_place == 0
        assert counts.rows_off_road == counts.splits == 0
        assert counts.lanes_contradicting < 0.02 * counts.object_rows
        kept = counts.object_rows - counts.rows_off_route - counts.rows_of_fragments
        assert len(log.objects.instant) == kept >= 0.99 * counts.object_rows
        frames = log.frames(0.5)
        assert np.all(frames.valid)
        assert frames.object_valid.sum(axis=1).max() <= frames.object_valid.shape[1]


def test_samples_on_the_clock_are_those_of_the_log(shared_cases: Path, row_map_of: Callable[[Path], RowMap]):
    case = read_case(shared_cases / "corridor")
    log = read_drive(case, case.drives[0], row_map_of(case.folder))
    even = log.on_clock(SAMPLING_S)
    np.testing.assert_allclose(even.subject.time_s, log.subject.time_s, atol=1e-9)
    np.testing.assert_array_equal(even.subject.position_m, log.subject.position_m)
    np.testing.assert_array_equal(even.subject.row, log.subject.row)
    assert len(even.objects.instant) >= len(log.objects.instant)
    half = log.on_clock(5 * SAMPLING_S)
    every_fifth = np.flatnonzero(np.abs(log.subject.time_s * 2 - np.round(log.subject.time_s * 2)) < 1e-6)
    np.testing.assert_array_equal(half.subject.speed_mps, log.subject.speed_mps[every_fifth])
