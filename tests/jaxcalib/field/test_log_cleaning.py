"""Splitting, gaps, fragments and numbers of tracks, on tables small enough to check by hand."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.field.log_cleaning import CleaningRules, CleanTracks, clean_tracks, rules_for

RULES = CleaningRules()


def clean(time_s, vehicle, offset_m, speed_mps=None, rules: CleaningRules = RULES) -> CleanTracks:
    time_s, vehicle, offset_m = np.asarray(time_s, float), np.asarray(vehicle), np.asarray(offset_m, float)
    speed_mps = np.full(len(time_s), 20.0) if speed_mps is None else np.asarray(speed_mps, float)
    return clean_tracks(time_s, vehicle, offset_m, speed_mps, rules)


def test_nothing_gives_nothing():
    tracks = clean([], [], [])
    assert (tracks.num_tracks, tracks.num_splits, tracks.num_gaps, tracks.num_fragments) == (0, 0, 0, 0)


def test_tracks_are_numbered_by_first_detection():
    time_s = [0, 1, 2, 1, 2, 3, 1, 2, 3]
    vehicle = [5, 5, 5, 2, 2, 2, 9, 9, 9]
    offset_m = [0, 0, 0, -10, -10, -10, 30, 30, 30]
    tracks = clean(time_s, vehicle, offset_m)
    # 5 is seen first; of 2 and 9, seen first together, 9 is farther ahead.
    np.testing.assert_array_equal(tracks.track, [0, 0, 0, 2, 2, 2, 1, 1, 1])
    assert tracks.num_tracks == 3


def test_a_short_gap_is_bridged():
    tracks = clean([0.0, 0.5, 1.5, 2.0], [1] * 4, [0] * 4)
    np.testing.assert_array_equal(tracks.episode, [0, 0, 0, 0])
    assert tracks.num_gaps == 0


def test_a_slow_log_with_uneven_time_stamps_has_no_gaps():
    time_s = np.arange(200.0) + np.random.default_rng(4).uniform(-0.2, 0.2, 200)
    usual, own = (clean(time_s, [1] * 200, [0] * 200, rules=one) for one in (RULES, rules_for(1.0)))
    assert usual.num_gaps > 30
    assert (own.num_gaps, own.num_fragments) == (0, 0)
    assert rules_for(0.1) == RULES


def test_a_long_gap_begins_an_episode_and_keeps_the_number():
    tracks = clean([0, 1, 3, 4], [1] * 4, [0] * 4)
    np.testing.assert_array_equal(tracks.episode, [0, 0, 1, 1])
    np.testing.assert_array_equal(tracks.track, [0, 0, 0, 0])
    assert (tracks.num_gaps, tracks.num_tracks) == (1, 1)


def test_fragments_shorter_than_a_second_are_dropped():
    time_s = [0, 0.5, 0.9, 5.0, 5.5, 6.0]
    tracks = clean(time_s, [1, 1, 1, 2, 2, 2], [0] * 6)
    np.testing.assert_array_equal(tracks.keep, [False] * 3 + [True] * 3)
    np.testing.assert_array_equal(tracks.track, [-1] * 3 + [0] * 3)
    np.testing.assert_array_equal(tracks.episode, [-1] * 3 + [1] * 3)
    assert (tracks.num_fragments, tracks.num_tracks) == (1, 1)


def test_a_vehicle_that_comes_back_keeps_its_number_although_its_first_visit_was_a_fragment():
    tracks = clean([0, 5, 6, 1, 2], [1, 1, 1, 2, 2], [0] * 5)
    np.testing.assert_array_equal(tracks.track, [-1, 1, 1, 0, 0])


def test_fragments_stay_if_the_rule_says_so():
    tracks = clean([0, 5], [1, 1], [0, 0], rules=CleaningRules(shortest_episode_s=0.0))
    np.testing.assert_array_equal(tracks.track, [0, 0])


def test_a_jump_along_the_road_begins_a_track():
    time_s = np.arange(8) * 0.5
    # 36 m in half a second are 72 m/s; 34 m are 68 m/s.
    tracks = clean(time_s, [1] * 8, [0, 0, 0, 36, 36, 36, 70, 70])
    np.testing.assert_array_equal(tracks.track, [0, 0, 0, 1, 1, 1, 1, 1])
    assert (tracks.num_splits, tracks.num_tracks) == (1, 2)


def test_errors_of_position_at_fast_sampling_are_no_jumps():
    time_s = np.arange(50) * 0.04
    offset_m = 5.0 * (np.arange(50) % 2)  # 125 m/s, but less than the 7 m that a tenth of a second allows
    assert clean(time_s, [1] * 50, offset_m).num_splits == 0


def test_a_jump_of_speed_that_lasts_begins_a_track_where_it_is_largest():
    time_s = np.arange(30) * 0.1
    speed = np.full(30, 20.0)
    speed[12:] = 14.0  # 6 m/s in 0.3 s are 20 m/s^2
    tracks = clean(time_s, [1] * 30, [0] * 30, speed)
    np.testing.assert_array_equal(tracks.track, [0] * 12 + [1] * 18)
    assert tracks.num_splits == 1


def test_a_single_odd_speed_and_a_hard_brake_split_nothing():
    time_s = np.arange(30) * 0.1
    odd = np.full(30, 20.0)
    odd[12] = 23.0  # 30 m/s^2 up and down, but 10 m/s^2 over three steps
    assert clean(time_s, [1] * 30, [0] * 30, odd).num_splits == 0
    brake = np.maximum(30.0 - 10.0 * time_s, 0.0)
    assert clean(time_s, [1] * 30, [0] * 30, brake).num_splits == 0


def test_the_speeds_of_two_vehicles_are_not_compared():
    time_s = [*np.arange(20) * 0.1, *np.arange(20) * 0.1]
    tracks = clean(time_s, [1] * 20 + [2] * 20, [0] * 40, [30.0] * 20 + [5.0] * 20)
    assert tracks.num_splits == 0


@given(st.integers(0, 2**32 - 1))
def test_the_order_of_rows_does_not_matter(seed: int):
    random = np.random.default_rng(seed)
    num_rows = 60
    time_s, vehicle = np.divmod(random.choice(5 * 40, num_rows, replace=False), 5)
    time_s = time_s * 0.5
    offset_m, speed = random.uniform(-60, 60, num_rows), random.uniform(0, 30, num_rows)
    tracks = clean(time_s, vehicle, offset_m, speed)
    order = random.permutation(num_rows)
    shuffled = clean(time_s[order], vehicle[order], offset_m[order], speed[order])
    np.testing.assert_array_equal(shuffled.keep, tracks.keep[order])
    np.testing.assert_array_equal(shuffled.track, tracks.track[order])
    np.testing.assert_array_equal(shuffled.episode, tracks.episode[order])


@given(st.integers(0, 2**32 - 1))
def test_numbers_are_dense_and_in_order_of_first_detection(seed: int):
    random = np.random.default_rng(seed)
    time_s, vehicle = np.divmod(random.choice(8 * 40, 120, replace=False), 8)
    tracks = clean(time_s * 0.5, vehicle, random.uniform(-20, 20, 120))
    seen = np.unique(tracks.track[tracks.keep])
    np.testing.assert_array_equal(seen, np.arange(tracks.num_tracks))
    first = [time_s[tracks.track == track].min() for track in seen]
    assert first == sorted(first)
