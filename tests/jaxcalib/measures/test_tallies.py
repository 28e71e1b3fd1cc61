"""Tallies add up, and nothing but what was seen goes into them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.measures.drive_tally import DriveTally
from jaxcalib.measures.fold import Fold, by_index, indexed
from jaxcalib.measures.measure import Measure
from jaxcalib.measures.scene import Scene
from sim_adapters.frame_table import ObjectTable, SubjectTable, stack_frames
from surrogate.road.perception import NO_TRACK, PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, NUM_PLACES, Car, drive, instant, random_drive

Count = Callable[[PerceptionFrame], dict[str, float]]

SEEDS = range(8)
# sums over vehicles of their means, and what needs the frame before: only these know of other frames
OF_VEHICLES = (
    "followers", "follower_headway_s", "follower_gap_s", "lane_changers", "lane_changer_target_gap_m",
    "observed_vehicles", "speed_variance", "free_vehicles", "free_speed", "free_speed_squared",
)  # fmt: skip
OF_STILL_FRAMES = (
    "vehicle_frames", "vehicle_speed", "vehicle_speed_squared", "lane_m_frames", "section_frames[0]",
    "section_speed[1]", "section_lane_m[1]", "row_frames[2]", "row_speed[1]", "subject_frames",
    "subject_acceleration_squared", "subject_section_speed[0]", "background_following_frames",
    "background_headway_s", "background_headway_squared", "background_gap_s", "background_spacing_m",
    "background_headways_censored", "background_headway_bin[4]", "following_speed_bin[2]", "subject_headway_s",
)  # fmt: skip


def cut(frames: PerceptionFrame, begin: int, end: int) -> PerceptionFrame:
    return jax.tree.map(lambda leaf: leaf[begin:end], frames)


def is_same(one: dict[str, float], other: dict[str, float], rtol: float = 1e-5) -> None:
    np.testing.assert_allclose(list(one.values()), list(other.values()), rtol=rtol, atol=1e-4)


def test_the_random_drives_have_something_to_count(count: Count):
    pooled = np.sum([list(count(random_drive(seed)).values()) for seed in SEEDS], axis=0)
    names = list(count(random_drive(0)))
    seen = {name for name, total in zip(names, pooled, strict=True) if total}
    must_be_seen = {
        "background_target_gap_m",
        "cut_ins",
        "overtaken",
        "overtakes",
        "subject_lane_changes",
        "free_speed",
    }
    assert must_be_seen | {"background_lane_change_durations"} | set(OF_VEHICLES) <= seen


@pytest.mark.parametrize("seed", SEEDS)
def test_a_drive_cut_in_two_adds_up_but_for_what_happens_at_the_cut(count: Count, seed: int):
    frames = random_drive(seed)
    whole, first, second = count(frames), count(cut(frames, 0, 3)), count(cut(frames, 3, 6))
    for name in OF_STILL_FRAMES:
        assert first[name] + second[name] == pytest.approx(whole[name], rel=1e-5, abs=1e-4)
    assert (whole["drives"], first["drives"] + second["drives"]) == (1, 2)
    # the interval at the cut belongs to neither part
    assert first["subject_time_s"] + second["subject_time_s"] == pytest.approx(whole["subject_time_s"] - 0.5)
    lost_m = 0.5 * float(frames.subject_speed_mps[3])
    expected = pytest.approx(whole["subject_distance_m"] - lost_m, rel=1e-5)
    assert first["subject_distance_m"] + second["subject_distance_m"] == expected
    for name in ("background_lane_changes", "cut_ins", "overtaken", "overtakes"):
        at_the_cut = count(cut(frames, 2, 4))[name]
        assert first[name] + second[name] + at_the_cut == whole[name]


def test_measures_of_two_drives_are_those_of_all_their_frames(count: Count, measures: dict[str, Measure]):
    """Two drives of different length: the pooled mean weighs observations, not drives."""
    one = drive(instant(0.0, Car(EGO, 0, 500.0, 20.0), Car(0, 0, 530.0, 16.0)))
    other = drive(*(instant(0.5 * k, Car(EGO, 0, 500.0, 10.0), Car(0, 0, 512.0, 16.0)) for k in range(3)))
    pooled = {name: value + count(other)[name] for name, value in count(one).items()}
    headway = measures["subject_time_headway_s"].value(pooled)
    assert headway.value == pytest.approx((30 / 20 + 3 * 12 / 10) / 4)
    assert headway.num_observations == 4
    deviation = measures["subject_time_headway_deviation_s"].value(pooled).value
    assert deviation == pytest.approx(np.std([1.5, 1.2, 1.2, 1.2], ddof=1), rel=1e-4)
    assert measures["subject_travel_time_s"].value(pooled).value == pytest.approx((0.0 + 1.0) / 2)


def with_gap(frames: PerceptionFrame, place: int, seed: int) -> PerceptionFrame:
    """Return a drive with two frames of nonsense in it that are not valid."""
    nonsense = replace(
        cut(random_drive(seed), 0, 2),
        valid=np.zeros(2, bool),
        subject_speed_mps=np.full(2, 99.0, np.float32),
        subject_acceleration_mps2=np.full(2, 1e9, np.float32),
    )
    parts = cut(frames, 0, place), nonsense, cut(frames, place, 6)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("place", [0, 6])
def test_frames_that_are_not_valid_change_nothing(count: Count, seed: int, place: int):
    frames = random_drive(seed)
    assert count(with_gap(frames, place, seed + 100)) == count(frames)


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_happens_across_a_gap(count: Count, seed: int):
    """What is counted from frame to frame is that of the two parts; a vehicle is the same before and after."""
    frames = random_drive(seed)
    mixed, whole = count(with_gap(frames, 3, seed + 100)), count(frames)
    first, second = count(cut(frames, 0, 3)), count(cut(frames, 3, 6))
    of_the_drive = {"drives", "subject_time_s", "subject_distance_m"}  # time goes on for the subject vehicle
    for name in set(mixed) - {*OF_VEHICLES, *of_the_drive}:
        assert mixed[name] == pytest.approx(first[name] + second[name], rel=1e-5, abs=1e-4), name
    assert mixed["subject_time_s"] == pytest.approx(whole["subject_time_s"])
    for name in set(OF_VEHICLES) - {"lane_changers", "lane_changer_target_gap_m"}:
        assert mixed[name] == pytest.approx(whole[name], rel=1e-5, abs=1e-4), name


def test_a_drive_with_a_gap_is_one_drive(count: Count):
    assert count(with_gap(random_drive(0), 3, 100))["drives"] == 1


@pytest.mark.parametrize("seed", SEEDS)
def test_what_lies_in_empty_places_changes_nothing(count: Count, seed: int):
    frames = random_drive(seed)
    empty = ~frames.object_valid
    spoilt = replace(
        frames,
        object_row=np.where(empty, 1, frames.object_row),
        object_track=np.where(empty, 3, frames.object_track),
        object_offset_m=np.where(empty, np.float32(-33.0), frames.object_offset_m),
        object_speed_mps=np.where(empty, np.float32(77.0), frames.object_speed_mps),
        object_lateral_m=np.where(empty, np.float32(np.nan), frames.object_lateral_m),
    )
    assert empty.any()
    assert count(spoilt) == count(frames)


def test_empty_places_between_rows_change_nothing(count: Count):
    """Rows of the surrogate's frames have places of their own, some of them empty."""
    cars = Car(EGO, 0, 500.0, 20.0), Car(0, 0, 470.0, 22.0), Car(1, 1, 540.0, 19.0), Car(2, 1, 490.0, 18.0)
    frames = drive(*(instant(0.5 * k, *cars) for k in range(2)))
    order = np.asarray([4, 0, 1, 5, 2, 3, *range(6, NUM_PLACES)])  # one empty place before each row
    objects = {name: getattr(frames, name)[:, order] for name in vars(frames) if name.startswith("object_")}
    assert objects["object_valid"][0, :7].tolist() == [False, True, True, False, True, True, False]
    is_same(count(replace(frames, **objects)), count(frames))


def test_more_places_change_nothing(count: Count):
    frames = random_drive(2)
    fill = {"object_track": NO_TRACK}
    wide = {
        name: np.pad(getattr(frames, name), ((0, 0), (0, 5)), constant_values=fill.get(name, 0))
        for name in vars(frames)
        if name.startswith("object_")
    }
    is_same(count(replace(frames, **wide)), count(frames))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_numbers_of_the_vehicles_do_not_matter(count: Count, seed: int):
    frames = random_drive(seed)
    number = np.append(np.random.default_rng(seed).permutation(6), NO_TRACK)  # NO_TRACK = -1 takes the last place
    renamed = replace(frames, object_track=number[frames.object_track].astype(np.int32))
    is_same(count(renamed), count(frames))


@pytest.mark.parametrize("shift_s", [0.0, 260.0, 4000.0])
def test_the_clock_does_not_matter(count: Count, shift_s: float):
    frames = random_drive(4)
    is_same(count(replace(frames, time_s=frames.time_s + np.float32(shift_s))), count(frames), rtol=1e-3)


def test_frames_from_tables_are_those_made_by_hand(count: Count):
    """Tables may come in any order; what lies beyond the sensors' range is left out."""
    cars = [
        (Car(2, 1, 480.0, 17.0), Car(EGO, 0, 500.0, 20.0), Car(0, 0, 540.0, 18.0), Car(1, 1, 600.0, 21.0)),
        (Car(EGO, 1, 510.0, 20.0), Car(0, 0, 549.0, 18.0), Car(2, 1, 488.5, 17.0)),  # 1 is 0.5 m too far away
    ]
    by_hand = drive(*(instant(3.0 + 0.5 * k, *seen) for k, seen in enumerate(cars)))
    rows = [
        (0, cars[0][2]),
        (1, cars[1][1]),
        (1, Car(1, 1, 610.5, 21.0)),
        (0, cars[0][3]),
        (1, cars[1][2]),
        (0, cars[0][0]),
    ]
    ego_m = np.asarray([500.0, 510.0])
    number = np.asarray([k for k, _ in rows])
    table = ObjectTable(
        instant=number,
        track=np.asarray([car.track for _, car in rows]),
        row=np.asarray([car.row for _, car in rows]),
        offset_m=np.asarray([car.front_m for _, car in rows]) - ego_m[number],
        speed_mps=np.asarray([car.speed_mps for _, car in rows]),
        lateral_m=np.full(len(rows), np.nan),
    )
    two = np.ones(2)
    subject = SubjectTable(np.asarray([3.0, 3.5]), ego_m, 20 * two, 0 * two, np.asarray([0, 1]), np.nan * two, 2 * two)
    stacked = stack_frames(subject, table, 100.0, 60.0, least_places=8)
    for made, expected in zip(jax.tree.leaves(stacked), jax.tree.leaves(by_hand), strict=True):
        np.testing.assert_array_equal(made, expected)
    assert count(stacked)["subject_lane_changes"] == 1


def test_vehicles_beyond_the_table_of_tracks_are_seen_but_not_remembered(count: Count, tally: DriveTally):
    assert tally.settings.num_tracks == 8
    ego = Car(EGO, 0, 500.0, 20.0)
    frames = drive(
        instant(0.0, ego, Car(6, 1, 520.0, 15.0), Car(5, 0, 520.0, 15.0)),
        instant(0.5, ego, Car(6, 0, 560.0, 15.0), Car(5, 1, 520.0, 15.0)),
    )
    tallies = count(frames)
    assert tallies["vehicle_frames"] == 6
    assert tallies["background_lane_changes"] == 1
    assert tallies["observed_vehicles"] == 1


class Counts(Fold):
    """A fold that names four tallies, three of them by index, and counts what it is told."""

    counted: dict[str, Any]

    def names(self) -> tuple[str, ...]:
        return ("before", *indexed("by_bin", 3), "after")

    def count(self, scene: Scene) -> dict[str, Any]:
        return self.counted

    def track_names(self) -> tuple[str, ...]:
        return ("frames",)

    def count_per_track(self, scene: Scene) -> dict[str, Any]:
        return {"frames": scene.is_vehicle.astype(float)}


def counted_by(tally: DriveTally, counted: dict[str, Any]) -> list[float]:
    fold = Counts(counted)
    own = DriveTally(tally.settings, (fold,))
    frames = drive(*(instant(0.5 * number, Car(EGO, 0, 300.0, 20.0)) for number in range(2)))
    return np.asarray(own.of_frames(jax.tree.map(jnp.asarray, frames))).tolist()


@pytest.mark.parametrize(
    ("counted", "expected"),
    [
        ({"after": 4.0, **by_index("by_bin", jnp.asarray([1.0, 2.0, 3.0])), "before": 0.5}, [1.0, 2.0, 4.0, 6.0, 8.0]),
        ({"by_bin[1]": 2.0, "before": 0.5}, [1.0, 0.0, 4.0, 0.0, 0.0]),
        ({}, [0.0] * 5),
    ],
    ids=["an array", "one of its numbers", "nothing"],
)
def test_what_a_fold_counts_stands_where_its_names_do(
    tally: DriveTally, counted: dict[str, Any], expected: list[float]
):
    assert counted_by(tally, {name: jnp.asarray(value) for name, value in counted.items()}) == expected


@pytest.mark.parametrize(
    ("counted", "message"),
    [
        ({"else": 1.0}, "does not name: .*else"),
        ({"by_bin": [1.0, 2.0, 3.0, 4.0]}, "counts 4 numbers as by_bin"),
        ({"after": [1.0]}, "counts 1 numbers as after"),
    ],
)
def test_what_it_does_not_name_is_refused(tally: DriveTally, counted: dict[str, Any], message: str):
    with pytest.raises(KeyError, match=message):
        counted_by(tally, {name: jnp.asarray(value) for name, value in counted.items()})
