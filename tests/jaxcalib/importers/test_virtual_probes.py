"""Which vehicles become subject vehicles, and what they see."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.importers.importer import ImportOptions
from jaxcalib.importers.occlusion import visible_from_origin
from jaxcalib.importers.straight_road import DOWNSTREAM_M, UPSTREAM_M, straight_road_of, write_scenario
from jaxcalib.importers.trajectories import Recording, Slice, completed, slices_of
from jaxcalib.importers.virtual_probes import virtual_probes
from tests.jaxcalib.importers.recorded_traffic import traffic


def recording() -> Recording:
    truth = traffic().assign(acceleration_mps2=np.nan, heading_rad=0.0)
    return Recording("one", lambda: slices_of(truth))


def test_those_that_drive_far_are_taken_evenly_over_the_time():
    drives, _ = virtual_probes([recording()], ImportOptions(probes=5, range_m=20.0))
    assert len(drives) == 5
    begins_s = [float(drive.subject.time_s.iloc[0]) for drive in drives]
    assert begins_s == sorted(begins_s)
    assert min(np.ptp(drive.subject.x_m) for drive in drives) + 2 * 20.0 > 0.6 * 600.0
    assert all(drive.range_m == 20.0 for drive in drives)


def test_on_the_scenario_s_clock_times_are_kept_and_an_empty_road_is_not_looked_at():
    """Vehicles enter an empty road every four seconds; those that meet nobody ahead are no probes."""
    time_s = np.round(np.arange(0.0, 20.0, 0.2), 3)
    tracks = [
        pd.DataFrame({"vehicle": str(n), "time_s": 4.0 * n + time_s, "x_m": 30.0 * time_s, "y_m": 1.8})
        for n in range(20)
    ]
    table = completed(pd.concat(tracks, ignore_index=True))
    for has_clock, earliest_s in ((True, 19.0), (False, 0.0)):
        source = Recording("road", lambda: slices_of(table), has_scenario_clock=has_clock)
        drives, _ = virtual_probes([source], ImportOptions(probes=4, begin_s=0.0))
        begins_s = [float(drive.subject.time_s.iloc[0]) for drive in drives]
        assert earliest_s <= min(begins_s) < earliest_s + 8.0
        assert max(float(drive.subject.time_s.iloc[-1]) for drive in drives) < table.time_s.max()  # whole drives


def even_traffic(length_m: float, begin_m: float = 0.0) -> Recording:
    """A stretch on which vehicles are equally dense everywhere: of one pace, some 25 m apart."""
    random = np.random.default_rng(5)
    time_s = np.round(np.arange(0.0, 60.0, 0.2), 3)
    tracks = []
    for number in range(100):
        x_m = length_m - 25.0 * (number + random.uniform()) + 30.0 * time_s
        track = pd.DataFrame({"vehicle": str(number), "time_s": time_s, "x_m": x_m, "y_m": 1.8 + 3.6 * (number % 2)})
        tracks.append(track[(x_m >= 0.0) & (x_m <= length_m)])
    table = completed(pd.concat(tracks, ignore_index=True).assign(lane=1, length_m=4.5))
    return Recording("even", lambda: slices_of(table.assign(x_m=table.x_m + begin_m)))


@pytest.mark.parametrize("asked_m", [None, 50.0])
def test_even_traffic_has_the_same_volume_in_all_sections(asked_m: float | None):
    """Each section is seen for as long as it is in range: vehicles there by length and time, times their speed."""
    length_m = 400.0
    drives, _ = virtual_probes([even_traffic(length_m)], ImportOptions(probes=20, range_m=asked_m))
    assert len(drives) == 20
    borders_m = np.linspace(-150.0, 550.0, 8)  # of sections that begin and end where nothing was recorded
    vehicles, seen_m = np.zeros(7), np.zeros(7)
    for drive in drives:
        assert drive.range_m is not None
        x_m = drive.subject.x_m.to_numpy()
        for section, (begin_m, end_m) in enumerate(itertools.pairwise(borders_m)):
            ahead_m, behind_m = np.minimum(x_m + drive.range_m, end_m), np.maximum(x_m - drive.range_m, begin_m)
            seen_m[section] += np.clip(ahead_m - behind_m, 0.0, None).sum()
        vehicles += np.histogram(np.concatenate([drive.objects.x_m, x_m]), borders_m)[0]
    assert (seen_m > 0.0).tolist() == [False, True, True, True, True, True, False]
    vehph = 3600.0 * 30.0 * vehicles[1:-1] / seen_m[1:-1]
    np.testing.assert_allclose(vehph, 3600.0 * 30.0 / 25.0, rtol=0.05)  # places are drawn at random within 25 m


def test_range_is_shorter_on_a_short_stretch_and_said():
    for length_m, range_m, why in (
        (1000.0, 150.0, ""),
        (400.0, 90.0, ", not 150 m, for the recorded stretch is 400 m long"),
    ):
        drives, said = virtual_probes([even_traffic(length_m)], ImportOptions(probes=20))
        assert said == (
            f"virtual probes see {range_m:g} m ahead and behind{why}; they count where all that was recorded."
        )
        assert {drive.range_m for drive in drives} == {range_m}
        driven_m = max(float(np.ptp(drive.subject.x_m)) for drive in drives)
        assert driven_m == pytest.approx(length_m - 2 * range_m, abs=12.0)  # rows are 6 m apart, at both ends


def test_a_range_with_which_too_little_remains_is_refused():
    with pytest.raises(
        CaseError, match=r"--range-m: expected at most 90 m, got 150 m: .* half of the stretch of 400 m\."
    ):
        virtual_probes([even_traffic(400.0)], ImportOptions(range_m=150.0))
    with pytest.raises(CaseError, match=r"expected a longer stretch of road than 3\d m"):
        virtual_probes([even_traffic(36.0)], ImportOptions(subjects=("11",)))


def test_probes_that_were_recorded_on_too_short_a_way_are_left_out_and_said():
    recordings = [replace(even_traffic(length_m), id=f"{length_m:g}") for length_m in (1000.0, 1000.0, 200.0)]
    drives, said = virtual_probes(recordings, ImportOptions(probes=4))
    assert [drive.id.split("-")[0] for drive in drives] == ["1000"] * 8
    assert said.endswith("4 of 12 drives are too short then, and left out.")


@pytest.mark.parametrize("begin_m", [0.0, 2000.0])
def test_nothing_is_missing_where_the_road_itself_ends(begin_m: float, tmp_path: Path):
    table = pd.concat(
        [pd.DataFrame({"vehicle": one.vehicle, "time_s": one.time_s, "x_m": one.x_m, "y_m": one.y_m, "lane": one.lane,
                       "speed_mps": one.speed_mps, "length_m": one.length_m})
         for one in even_traffic(400.0).slices()], ignore_index=True)  # fmt: skip
    road = straight_road_of(table)
    road = replace(road, begin_m=road.begin_m + UPSTREAM_M - 10.0, end_m=road.end_m - DOWNSTREAM_M + 10.0)
    config = write_scenario(road, tmp_path, 900.0)
    drives, said = virtual_probes([even_traffic(400.0, begin_m)], ImportOptions(config=config))
    is_whole = begin_m == 0.0
    assert said.startswith(f"virtual probes see {150 if is_whole else 90} m ahead")
    driven_m = max(float(np.ptp(drive.subject.x_m)) for drive in drives)
    assert driven_m == pytest.approx(400.0 if is_whole else 220.0, abs=12.0)  # rows are 6 m apart, at both ends


def test_dense_recordings_are_thinned():
    truth = traffic().assign(acceleration_mps2=np.nan, heading_rad=0.0)
    dense = [truth.assign(time_s=truth.time_s + shift_s, x_m=truth.x_m + 20.0 * shift_s) for shift_s in (0.0, 0.04)]

    def slices() -> Iterator[Slice]:
        pairs = zip(*(slices_of(table) for table in dense), strict=True)
        yield from (one for pair in pairs for one in pair)

    ((drive,), _) = virtual_probes([Recording("dense", slices)], ImportOptions(subjects=("11",)))
    assert np.diff(drive.subject.time_s).min() == pytest.approx(0.2)


def test_who_stays_for_a_moment_is_no_probe():
    short = traffic().query("time_s < 3").assign(acceleration_mps2=np.nan, heading_rad=0.0)
    with pytest.raises(CaseError, match="expected a vehicle that stays for 5 s"):
        virtual_probes([Recording("short", lambda: slices_of(short))], ImportOptions())


def test_range_and_direction_are_the_vehicle_s_own():
    """A recording turned by a quarter gives the same tables, turned."""
    truth = traffic().assign(acceleration_mps2=np.nan)
    turned = truth.assign(x_m=-truth.y_m, y_m=truth.x_m, heading_rad=np.pi / 2)
    options = ImportOptions(subjects=("11",), range_m=80.0, is_occluded=True)
    ((straight,), _), ((quarter,), _) = (
        virtual_probes([Recording("r", lambda table=table: slices_of(table))], options)
        for table in (truth.assign(heading_rad=0.0), turned)
    )
    assert quarter.objects.vehicle_id.tolist() == straight.objects.vehicle_id.tolist()
    np.testing.assert_allclose(quarter.objects.y_m, straight.objects.x_m)


def test_who_is_hidden():
    """Right behind a nearer one in the same lane nobody is seen; beside it, and in the next lane, everybody."""
    x_m = np.asarray([20.0, 40.0, 42.0, -15.0, -30.0, 3.0])
    y_m = np.asarray([0.0, 0.0, 3.6, 0.0, 0.3, 3.6])
    length_m = np.full(6, 4.5)
    assert visible_from_origin(x_m, y_m, length_m).tolist() == [True, False, True, True, False, True]
    order = np.asarray([3, 1, 5, 0, 2, 4])
    shuffled = visible_from_origin(x_m[order], y_m[order], length_m)
    assert shuffled.tolist() == [True, False, True, True, True, False]


def test_a_truck_hides_more_than_a_car():
    x_m, y_m = np.asarray([25.0, 60.0]), np.asarray([0.0, 2.9])
    seen = [visible_from_origin(x_m, y_m, np.asarray([length_m, 4.5]))[1] for length_m in (4.0, 16.0)]
    assert seen == [True, False]
