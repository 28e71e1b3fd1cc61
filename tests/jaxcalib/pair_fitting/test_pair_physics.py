"""Pairs that contradict themselves: units, exchanged roles, other leaders, sentinels; real pairs are believed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.pair_fitting.pair_physics import believed_pairs, judge_pair, judge_table
from jaxcalib.pair_fitting.recorded_pairs import STEP_S, RecordedPair, read_pairs
from tests.places import SHARED_DATA

FOOT_M = 0.3048
Spoil = Callable[[RecordedPair], RecordedPair]


def pair(number: int) -> RecordedPair:
    """A follower that keeps 12 m and 1.4 s behind a leader whose speed swings; gaps are noisy as a radar's."""
    random = np.random.default_rng(number)
    time_s = STEP_S * np.arange(800)
    leader_mps = 17.0 + 5.0 * np.sin(time_s / (5.0 + number)) + 2.0 * np.sin(time_s / 2.3 + number)
    follower_mps, gap_m = np.full(800, 16.0), np.full(800, 30.0)
    for step in range(1, 800):
        gap_m[step] = gap_m[step - 1] + STEP_S * (leader_mps[step - 1] - follower_mps[step - 1])
        wanted_mps = (gap_m[step] - 12.0) / 1.4
        follower_mps[step] = follower_mps[step - 1] + STEP_S * np.clip(wanted_mps - follower_mps[step - 1], -3.0, 2.0)
    return RecordedPair(f"p{number}", leader_mps, follower_mps, gap_m + random.normal(0.0, 0.1, 800))


def scaled(leader: float = 1.0, follower: float = 1.0, gap: float = 1.0) -> Spoil:
    return lambda one: replace(
        one, leader_mps=leader * one.leader_mps, follower_mps=follower * one.follower_mps, gap_m=gap * one.gap_m
    )


UNITS: dict[str, tuple[Spoil, str]] = {
    "exchanged": (
        lambda one: replace(one, leader_mps=one.follower_mps, follower_mps=one.leader_mps), "leader and follower",
    ),
    "gap in feet": (scaled(gap=1 / FOOT_M), "gap seems to be in feet"),
    "speeds in km/h": (scaled(3.6, 3.6), "both speeds seem to be in km/h"),
    "speeds in mph": (scaled(2.237, 2.237), "both speeds seem to be in mph"),
    "speeds in ft/s": (scaled(1 / FOOT_M, 1 / FOOT_M), "both speeds seem to be in ft/s"),
    "leader in km/h": (scaled(leader=3.6), "leader's speed seems to be in km/h"),
    "follower in mph": (scaled(follower=2.237), "follower's speed seems to be in mph"),
    "relative leader": (
        lambda one: replace(one, leader_mps=one.leader_mps - one.follower_mps), "relative to the follower's",
    ),
}  # fmt: skip


def test_what_is_right_is_believed():
    pairs = [pair(number) for number in range(6)]
    assert judge_table(pairs) is None
    assert [judge_pair(one) for one in pairs] == [None] * 6


@pytest.mark.parametrize("fault", UNITS)
def test_units_and_roles_are_named(fault: str):
    spoil, words = UNITS[fault]
    pairs = [pair(number) for number in range(6)]
    assert all(words in (judge_pair(spoil(one)) or "") for one in pairs)
    assert words in (judge_table([spoil(one) for one in pairs]) or "")


def test_feet_alike_cannot_be_seen():
    assert judge_pair(scaled(1 / FOOT_M, 1 / FOOT_M, 1 / FOOT_M)(pair(1))) is None


def test_a_pair_that_is_spoilt_is_left_out_with_the_reason(tmp_path):
    jump = pair(1)
    jump.gap_m[400:] += 14.0
    sentinel = pair(2)
    sentinel.gap_m[100:110] = 9999.0
    held = pair(3)
    held.gap_m[200:300] = held.gap_m[200]
    foreign = replace(pair(4), gap_m=30.0 + 15.0 * np.sin(np.arange(800) / 7.0))
    good = [pair(number) for number in range(5, 12)]
    kept, left_out = believed_pairs(tmp_path / "pairs.csv", [jump, sentinel, held, foreign, *good])
    assert [one.name for one in kept] == [one.name for one in good]
    for line, words in zip(
        left_out, ("jumps by 1", "9999 m stands for nothing", "clamped, or held", "nothing to do with it"), strict=True
    ):
        assert words in line


def test_a_table_in_other_units_is_refused(tmp_path):
    spoil, words = UNITS["gap in feet"]
    with pytest.raises(CaseError, match=f"gap_m: the {words}"):
        believed_pairs(tmp_path / "pairs.csv", [spoil(pair(number)) for number in range(3)])


FILES = ("ngsim_i80_human_pairs", "openacc_astazero", "openacc_zalazone")


@pytest.mark.parametrize("name", FILES)
def test_recorded_pairs_are_believed(name: str):
    file = SHARED_DATA / f"car_following/{name}.csv.gz"
    if not file.is_file():
        pytest.skip(f"needs shared/data: car_following/{name}.csv.gz")
    pairs, _ = read_pairs(file, drops_bad=True)
    kept, left_out = believed_pairs(file, pairs)
    assert len(left_out) <= 0.01 * len(pairs)
    for spoil, words in UNITS.values():
        with pytest.raises(CaseError, match=words):
            believed_pairs(file, [spoil(one) for one in kept])
