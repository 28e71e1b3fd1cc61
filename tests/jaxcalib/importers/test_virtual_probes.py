"""Which vehicles become subject vehicles, and what they see."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.importers.importer import ImportOptions
from jaxcalib.importers.occlusion import visible_from_origin
from jaxcalib.importers.trajectories import Recording, Slice, completed, slices_of
from jaxcalib.importers.virtual_probes import virtual_probes
from tests.jaxcalib.importers.recorded_traffic import traffic


def recording() -> Recording:
    truth = traffic().assign(acceleration_mps2=np.nan, heading_rad=0.0)
    return Recording("one", lambda: slices_of(truth))


def test_those_that_drive_far_are_taken_evenly_over_the_time():
    drives = virtual_probes([recording()], ImportOptions(probes=5))
    assert len(drives) == 5
    begins_s = [float(drive.subject.time_s.iloc[0]) for drive in drives]
    assert begins_s == sorted(begins_s)
    assert min(np.ptp(drive.subject.x_m) for drive in drives) > 0.6 * 600.0
    assert all(drive.is_probe for drive in drives)


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
        drives = virtual_probes([source], ImportOptions(probes=4, begin_s=0.0))
        begins_s = [float(drive.subject.time_s.iloc[0]) for drive in drives]
        assert earliest_s <= min(begins_s) < earliest_s + 8.0
        assert max(float(drive.subject.time_s.iloc[-1]) for drive in drives) < table.time_s.max()  # whole drives


def test_dense_recordings_are_thinned():
    truth = traffic().assign(acceleration_mps2=np.nan, heading_rad=0.0)
    dense = [truth.assign(time_s=truth.time_s + shift_s, x_m=truth.x_m + 20.0 * shift_s) for shift_s in (0.0, 0.04)]

    def slices() -> Iterator[Slice]:
        pairs = zip(*(slices_of(table) for table in dense), strict=True)
        yield from (one for pair in pairs for one in pair)

    (drive,) = virtual_probes([Recording("dense", slices)], ImportOptions(subjects=("11",)))
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
    straight, quarter = (
        virtual_probes([Recording("r", lambda table=table: slices_of(table))], options)[0]
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
