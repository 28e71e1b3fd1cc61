"""From the two files of a drive to rows, places and frames; what does not fit the road is said in one line."""

import re
from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jaxcalib.case.case import Case
from jaxcalib.errors import LONGEST_MESSAGE, CaseError
from jaxcalib.field.drive_logs import read_drives
from jaxcalib.field.field_log import DriveLog, read_drive
from jaxcalib.field.log_cleaning import CleaningRules
from sim_adapters.scenario.road_builder import RowMap
from surrogate.road.perception import NO_TRACK

Tables = tuple[pd.DataFrame, pd.DataFrame]
LANE_WIDTH_M = 3.75


def value_at(table: pd.DataFrame, row: int, column: str) -> float:
    """Return a value; `row` as messages count it."""
    return float(table[column].to_numpy()[row - 2])


@pytest.fixture
def read(drive_case: Case, row_map: RowMap) -> Callable[..., DriveLog]:
    """Return a function that writes two tables and reads them as a drive."""

    def write_and_read(tables: Tables, rules: CleaningRules | None = None) -> DriveLog:
        drive = drive_case.drives[0]
        tables[0].to_csv(drive.subject_file, index=False)
        tables[1].to_csv(drive.objects_file, index=False)
        return read_drive(drive_case, drive, row_map, rules=rules)

    return write_and_read


def message(read: Callable[..., DriveLog], tables: Tables) -> str:
    with pytest.raises(CaseError) as error:
        read(tables)
    line = str(error.value)
    assert len(line) <= LONGEST_MESSAGE
    assert line.isprintable()
    return line


def spoil(table: pd.DataFrame, row: int, column: str, value: object) -> pd.DataFrame:
    """Return a table with one value replaced; `row` as messages count it."""
    table = table.copy()
    if isinstance(value, float):
        table[column] = table[column].astype(float)
    table.loc[row - 2, column] = value  # pyright: ignore[reportArgumentType]
    return table


def test_the_subject_vehicle_on_the_route(read: Callable, straight_drive: Tables):
    log = read(straight_drive)
    subject = log.subject
    np.testing.assert_allclose(subject.position_m, 250.0 + 20.0 * (subject.time_s - 10.0), atol=0.01)
    np.testing.assert_allclose(subject.lateral_m, 0.0, atol=0.01)
    np.testing.assert_allclose(subject.speed_mps, 20.0, rtol=1e-12)
    assert set(subject.row) == {0}
    # Lane 1 becomes lane 2 at the auxiliary lane; between the edges the road has as many lanes as before.
    np.testing.assert_array_equal(subject.num_lanes, np.where(subject.position_m < 303.0 - 1e-6, 3, 4))
    np.testing.assert_array_equal(log.yaw_rate_radps, np.zeros(51))
    assert (log.id, log.role) == ("d01", "fit")
    assert log.warnings == ()


def test_the_detected_vehicles_on_the_route(read: Callable, straight_drive: Tables):
    log = read(straight_drive)
    objects = log.objects
    assert (log.counts.subject_rows, log.counts.object_rows, log.counts.tracks) == (51, 102, 2)
    # Both are first seen at once; 7 is ahead of 9 and has number 0. No lane changes although the numbers shift.
    for track, row, offset_m in [(0, 1, 20.0), (1, 0, -10.0)]:
        mine = objects.track == track
        assert set(objects.row[mine]) == {row}
        np.testing.assert_allclose(objects.offset_m[mine], offset_m, atol=1e-9)
        np.testing.assert_allclose(objects.lateral_m[mine], 0.0, atol=0.01)
        np.testing.assert_array_equal(np.sort(objects.instant[mine]), np.arange(51))


@pytest.mark.parametrize(("interval_s", "num_frames"), [(0.5, 11), (0.1, 51), (1.0, 6)])
def test_frames(read: Callable, straight_drive: Tables, interval_s: float, num_frames: int):
    frames = read(straight_drive).frames(interval_s, least_places=4)
    assert frames.object_offset_m.shape == (num_frames, 32)
    assert np.all(frames.valid)
    np.testing.assert_allclose(frames.time_s, 10.0 + interval_s * np.arange(num_frames), rtol=1e-6)
    np.testing.assert_allclose(frames.subject_position_m, 250 + 20 * (frames.time_s - 10), atol=0.02)
    np.testing.assert_array_equal(frames.object_valid.sum(axis=1), 3)
    # Sorted by row and from the front to the rear: the subject vehicle, 9 behind it, 7 in the next row.
    np.testing.assert_array_equal(frames.object_track[:, :3], [[NO_TRACK, 1, 0]] * num_frames)
    np.testing.assert_array_equal(frames.object_is_subject[:, :3], [[True, False, False]] * num_frames)
    assert (frames.ahead_m[0], frames.behind_m[0]) == (100.0, 80.0)


def test_frames_in_a_gap_are_not_valid(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    gap = (subject.time_s > 12.05) & (subject.time_s < 13.95)
    gap_objects = (objects.time_s > 12.05) & (objects.time_s < 13.95)
    log = read((subject[~gap], objects[~gap_objects]))
    np.testing.assert_array_equal(log.frames(0.5).valid, [True] * 5 + [False] * 3 + [True] * 3)
    assert log.counts.long_gaps == 2
    assert log.counts.tracks == 2


def test_frames_need_an_interval(read: Callable, straight_drive: Tables):
    with pytest.raises(ValueError, match="Expected an interval > 0 s; got 0"):
        read(straight_drive).frames(0)


def test_parquet_gives_the_same_as_csv(read: Callable, straight_drive: Tables, drive_case: Case, row_map: RowMap):
    plain = read(straight_drive)
    drive = drive_case.drives[0]
    packed = type(drive)(
        "d01", 10.0, drive.subject_file.with_suffix(".parquet"), drive.objects_file.with_suffix(".parquet"), "fit"
    )
    straight_drive[0].to_parquet(packed.subject_file)
    straight_drive[1].to_parquet(packed.objects_file)
    log = read_drive(drive_case, packed, row_map)
    for field in fields(plain.objects):
        np.testing.assert_array_equal(getattr(log.objects, field.name), getattr(plain.objects, field.name))
    for field in fields(plain.subject):
        np.testing.assert_array_equal(getattr(log.subject, field.name), getattr(plain.subject, field.name))


def test_read_drives_reads_them_all(read: Callable, straight_drive: Tables, drive_case: Case, row_map: RowMap):
    read(straight_drive)
    assert [log.id for log in read_drives(drive_case, row_map).drives] == ["d01"]


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_shuffled_object_rows_give_the_same_frames(read: Callable, straight_drive: Tables, seed: int):
    subject, objects = straight_drive
    expected = read((subject, objects)).frames(0.5)
    found = read((subject, objects.sample(frac=1.0, random_state=seed))).frames(0.5)
    for name in ("object_track", "object_row", "object_offset_m", "object_speed_mps", "object_lateral_m"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_objects_between_the_subject_vehicles_samples_are_moved_to_them(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    objects = objects[objects.vehicle_id == 7].copy()
    objects["time_s"] += 0.04
    objects["speed_kmh"] = 90.0  # 5 m/s faster than the subject vehicle
    log = read((subject, objects[objects.time_s < 14.9]))
    np.testing.assert_allclose(log.objects.offset_m, 20.0 - 0.04 * 5.0, atol=1e-9)
    assert log.counts.rows_without_subject == 0


def test_objects_sampled_twice_as_often_count_once(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    between = objects.copy()
    between["time_s"] += 0.05
    between = between[between.time_s < 14.9]
    log = read((subject, pd.concat([between, objects])))
    pairs = set(zip(log.objects.instant, log.objects.track, strict=True))
    assert len(pairs) == len(log.objects.instant) == 102
    np.testing.assert_allclose(log.objects.offset_m[log.objects.track == 0], 20.0, atol=1e-9)


def test_lanes_may_be_missing(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    expected = read((subject, objects))
    found = read((subject.assign(lane=np.nan, road=""), objects.assign(lane=np.nan)))
    np.testing.assert_array_equal(found.subject.row, expected.subject.row)
    np.testing.assert_array_equal(found.objects.row, expected.objects.row)


@pytest.mark.parametrize("road", ["", "Ring Road"])
def test_the_edge_may_be_unknown(read: Callable, straight_drive: Tables, road: str):
    """Between two edges the numbers are those of the next one; the place across tells."""
    subject, objects = straight_drive
    log = read((subject.assign(road=road), objects))
    assert set(log.subject.row) == {0}
    assert log.warnings == ()


def test_the_place_across_may_be_missing(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    log = read((subject, objects.assign(relative_y_m=np.nan)))
    assert np.isnan(log.objects.lateral_m).all()
    far = np.abs(log.subject.position_m[log.objects.instant] + log.objects.offset_m - 301.5) > 1.6
    np.testing.assert_array_equal(log.objects.row[far], np.where(log.objects.track == 0, 1, 0)[far])


def test_a_missing_acceleration_is_taken_from_the_speeds(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    speed_kmh = 72.0 + 3.6 * (subject.time_s - 10.0)
    subject = subject.assign(speed_kmh=speed_kmh, acceleration_mps2=np.nan)
    log = read((spoil(subject, 5, "acceleration_mps2", 0.25), objects))
    np.testing.assert_allclose(np.delete(log.subject.acceleration_mps2, 3), 1.0, atol=1e-9)
    assert log.subject.acceleration_mps2[3] == 0.25
    assert log.warnings == ("d01_subject.csv: 50 of 51 rows have no acceleration; it is taken from the speeds.",)


def test_rows_without_a_place_are_left_out_and_told(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    subject = spoil(subject, 12, "longitude_rad", np.nan)
    objects = spoil(objects, 30, "relative_x_m", np.nan)
    log = read((subject, objects))
    assert (log.counts.subject_rows_without_place, log.counts.rows_without_subject) == (1, 2)
    assert log.counts.rows_without_place == 1
    assert log.warnings == (
        "d01_subject.csv: 1 of 51 rows have no place or no speed and are left out.",
        "d01_objects.csv: 2 of 102 rows have a time at which the subject vehicle has none or no place; left out.",
        "d01_objects.csv: 1 of 102 rows have no distance, no speed, or neither lane nor place across; left out.",
    )
    frames = log.frames(0.5)
    assert np.all(frames.valid)
    np.testing.assert_array_equal(frames.object_valid.sum(axis=1), 3)  # bridged by the clock


def test_objects_beside_and_beyond_the_road_are_left_out_and_counted(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    beside = objects[objects.vehicle_id == 9].assign(vehicle_id=11, lane=np.nan, relative_y_m=-2.5 * LANE_WIDTH_M)
    beyond = objects[objects.vehicle_id == 9].assign(vehicle_id=12, relative_x_m=-400.0)
    log = read((subject, pd.concat([objects, beside, beyond])))
    assert (log.counts.rows_off_road, log.counts.rows_off_route) == (51, 51)
    assert log.counts.tracks == 2


def test_an_empty_objects_table_is_a_warning(read: Callable, straight_drive: Tables):
    log = read((straight_drive[0], straight_drive[1].iloc[:0]))
    assert log.warnings == ("d01_objects.csv: no rows; measures of the background have nothing to go by.",)
    np.testing.assert_array_equal(log.frames(0.5).object_valid.sum(axis=1), 1)


def test_unread_columns_are_a_warning(read: Callable, straight_drive: Tables):
    log = read((straight_drive[0].assign(weather="sun"), straight_drive[1]))
    assert log.warnings == ("d01_subject.csv: columns that are not read: weather.",)


def test_jumps_split_tracks_and_are_told(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    after = (objects.vehicle_id == 7) & (objects.time_s > 12.45)
    objects = objects.assign(relative_x_m=objects.relative_x_m + np.where(after, 30.0, 0.0))
    objects["lane"] = np.nan
    log = read((subject, objects))
    assert (log.counts.splits, log.counts.tracks) == (1, 3)
    assert log.warnings == ("d01_objects.csv: 1 jumps; each one begins a new track.",)


def test_fragments_are_dropped_unless_the_rules_keep_them(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    objects = objects[(objects.vehicle_id == 9) | (objects.time_s < 10.45)]
    log = read((subject, objects))
    assert (log.counts.fragments, log.counts.rows_of_fragments, log.counts.tracks) == (1, 5, 1)
    assert read((subject, objects), CleaningRules(shortest_episode_s=0.0)).counts.tracks == 2


def test_a_few_contradicting_lanes_are_a_warning(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    log = read((spoil(subject, 3, "lane", 2), spoil(objects, 4, "lane", 1)))
    assert log.subject.row[1] == 1
    assert log.warnings == (
        "d01_subject.csv: 1 of 51 rows have a lane other than where the place lies; the lane counts.",
        "d01_objects.csv: 1 of 102 rows have a lane other than their place across; the lane counts.",
    )


def test_a_road_that_is_elsewhere_is_a_warning(read: Callable, straight_drive: Tables):
    log = read((spoil(straight_drive[0], 3, "road", "c"), straight_drive[1]))
    assert log.warnings == (
        "d01_subject.csv: 1 of 51 rows name a road other than where the place lies; the place counts.",
    )


def test_a_position_that_runs_backwards_is_a_warning(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    for column in ("longitude_rad", "latitude_rad"):
        subject = spoil(subject, 21, column, value_at(subject, 7, column))
    log = read((subject, objects))
    assert log.warnings == ("d01_subject.csv: 1 of 51 rows lie more than 5 m behind the row before.",)


def test_a_few_objects_at_other_times_are_a_warning(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    log = read((subject[subject.time_s < 14.75], objects))
    assert log.counts.rows_without_subject == 6
    assert log.warnings == (
        "d01_objects.csv: 6 of 102 rows have a time at which the subject vehicle has none or no place; left out.",
    )


def test_objects_at_other_times_are_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    assert message(read, (subject, objects.assign(time_s=objects.time_s + 30.0))) == (
        "d01_objects.csv: row 2: expected a time stamp of d01_subject.csv; it has none near, here and in 100% of the "
        "rows."
    )


def test_a_place_off_the_map_is_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    expected = "columns longitude_rad and latitude_rad: expected a place within 30 m of the route, got one"
    # 101 m to the left of the rightmost lane are 93.5 m to the left of the leftmost.
    north = value_at(subject, 7, "latitude_rad") + 101.0 / 6_371_000.0
    line = message(read, (spoil(subject, 7, "latitude_rad", north), objects))
    assert re.fullmatch(rf"d01_subject.csv: row 7, {expected} 9[1-4] m away.", line)
    elsewhere = spoil(subject, 2, "longitude_rad", 0.1)
    assert message(read, (elsewhere, objects)).startswith(f"d01_subject.csv: row 2, {expected} ")


def test_a_subject_vehicle_without_places_is_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    assert message(read, (subject.assign(latitude_rad=np.nan), objects)) == (
        "d01_subject.csv: row 2: expected longitude_rad and latitude_rad and speed_kmh; one is missing, here and in "
        "100% of the rows."
    )


def test_a_lane_that_the_road_does_not_have_is_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    assert message(read, (spoil(subject, 3, "lane", 6), objects)) == (
        'd01_subject.csv: row 3, column lane: expected 1 to 3, the lanes of edge "a", got 6.'
    )
    assert message(read, (subject, spoil(objects, 50, "lane", 5))) == (
        'd01_objects.csv: row 50, column lane: expected 1 to 4, the lanes of edge "b", got 5.'
    )


def test_lanes_counted_from_the_left_are_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    assert message(read, (subject.assign(lane=3), objects)) == (
        "d01_subject.csv: row 2, column lane: expected the lane where longitude_rad and latitude_rad lie, got 3; "
        "100% of the rows contradict so. Lanes seem to be counted from the left; 1 is to be the rightmost, unless "
        "[log] has lanes_from."
    )


def test_an_exchanged_sign_across_is_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    assert message(read, (subject, objects.assign(relative_y_m=-objects.relative_y_m))).startswith(
        "d01_objects.csv: row 2: expected lane (1 = rightmost) and relative_y_m (+ left) to mean one lane; "
    )


def test_a_time_before_the_departure_is_refused(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    assert message(read, (spoil(subject, 2, "time_s", 8.5), objects)) == (
        "d01_subject.csv: row 2, column time_s: expected 9 to 100 on the scenario's clock, got 8.5."
    )
