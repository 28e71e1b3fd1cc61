"""Traffic vehicle by vehicle: from when, until when, in one piece or in two."""

import numpy as np
import pytest

from jaxcalib.exporters.tracks import read_tracks
from jaxcalib.importers.trajectories import Slice
from tests.jaxcalib.exporters.traffic import slice_at

STEP_S = 0.1


def slices() -> list[Slice]:
    """The subject vehicle is there from the third to the twelfth instant; one other is away for two instants."""
    made = []
    for number in range(14):
        time_s = 300.0 + STEP_S * number
        vehicles = {"b": (100.0 - 10.0 * number, 0.0, np.pi, 100.0)}
        if 2 <= number < 12:
            vehicles["s"] = (0.0, 3.0, 0.0, 1.0 + number)
        if number not in (6, 7):
            vehicles["a"] = (500.0, 0.0, np.radians(-179.0 if number % 2 else 179.0), 0.0)
        if number == 11:
            vehicles["c"] = (1.0, 0.0, 0.0, 0.0)
        made.append(slice_at(time_s, vehicles))
    return made


def test_time_begins_with_the_subject_vehicle_and_a_gap_makes_two_tracks_of_one():
    tracks = read_tracks(slices(), "s")
    assert [track.vehicle for track in tracks] == ["s", "a", "b", "a"]
    assert [track.time_s[[0, -1]].tolist() for track in tracks] == [[0.0, 0.9], [0.0, 0.3], [0.0, 0.9], [0.6, 0.9]]
    assert tracks[0].speed_mps.tolist() == [1.0 + number for number in range(2, 12)]
    assert tracks[2].x_m.tolist() == [100.0 - 10.0 * number for number in range(2, 12)]


def test_headings_go_on_over_half_a_turn():
    heading_rad = read_tracks(slices(), "s")[1].heading_rad
    assert np.abs(np.diff(heading_rad)) == pytest.approx(np.radians(2.0))


def test_within_a_range_others_are_there_from_the_first_to_the_last_time_that_they_are_near():
    tracks = read_tracks(slices(), "s", 45.0)
    assert [track.vehicle for track in tracks] == ["s", "b"]
    assert tracks[1].time_s.tolist() == pytest.approx([0.4, 0.5, 0.6, 0.7, 0.8, 0.9])  # from x = 40 on


def test_a_subject_vehicle_that_is_nowhere_is_an_error():
    with pytest.raises(ValueError, match="'x' is nowhere"):
        read_tracks(slices(), "x")
