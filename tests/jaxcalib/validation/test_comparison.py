"""Prediction intervals, distances and errors of trajectories against closed forms and coverage."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.measures.measure import LeftOut, Level, Measure, Percentile
from jaxcalib.validation.comparison import (
    compare_distributions,
    compare_measures,
    compare_trajectories,
    correct_together,
    cut_short,
    travel_time_table,
)
from jaxcalib.validation.distributions import BORDERS, distances
from jaxcalib.validation.judgement import arrival_criterion, travel_time_criterion
from jaxcalib.validation.observer import ObservedDrives
from jaxcalib.validation.prediction import exceedance, predict, upper_limit
from jaxcalib.validation.trajectories import CELL_M, passing_rmse_s, route_grid, speed_rmse_mps, travel_times_s


def test_a_prediction_interval_holds_nine_in_ten():
    rng = np.random.default_rng(4)
    draws = 3.0 + 0.7 * rng.standard_normal((4000, 9))
    inside = []
    for row in draws:
        found = predict(row[:8], row[8])
        assert found is not None
        inside.append(found.lower <= row[8] <= found.upper)
        assert (found.p_value >= 0.1) == inside[-1]
    assert np.mean(inside) == pytest.approx(0.9, abs=0.015)  # three standard errors


def test_limits_by_chance_are_exceeded_in_one_case_in_twenty():
    rng = np.random.default_rng(5)
    draws = np.exp(0.4 * rng.standard_normal((4000, 7)))
    above = [row[6] > upper_limit(row[:6]) for row in draws]
    assert np.mean(above) == pytest.approx(0.05, abs=0.011)
    for row, is_above in zip(draws[:50], above[:50], strict=True):
        assert (exceedance(row[:6], row[6]) < 0.05) == is_above


def test_too_few_rounds_predict_nothing():
    assert predict(np.asarray([1.0, np.nan, 2.0]), 1.5) is None
    assert np.isnan(upper_limit(np.asarray([1.0, 2.0])))
    assert np.isnan(exceedance(np.asarray([1.0, 2.0]), 3.0))


@given(shift=st.integers(1, 60), name=st.sampled_from(sorted(BORDERS)))
def test_the_distance_of_a_shifted_distribution_is_the_shift(shift: int, name: str):
    width = float(np.diff(BORDERS[name])[0])
    one = np.zeros(len(BORDERS[name]) - 1)
    one[7:20] = np.arange(3.0, 16.0)
    _, wasserstein = distances(name, one, 2.0 * np.roll(one, shift))
    assert wasserstein == pytest.approx(shift * width)
    assert distances(name, one, 5.0 * one) == pytest.approx((0.0, 0.0))


def test_the_distance_of_distributions_that_do_not_meet():
    one, other = np.zeros((2, 240))
    one[3], other[9] = 5.0, 2.0
    assert distances("subject_speed_mps", one, other) == pytest.approx((1.0, 6 * 0.25))
    assert np.isnan(distances("subject_speed_mps", one, np.zeros(240))).all()


def passing(speed_mps: float, depart_s: float, cells: int = 20) -> np.ndarray:
    return depart_s + route_grid(CELL_M * cells) / speed_mps


def test_errors_of_trajectories_at_constant_speed():
    slow, fast = passing(10.0, 300.0), passing(12.5, 340.0)
    assert speed_rmse_mps(slow, fast) == pytest.approx(2.5)
    assert travel_times_s(slow, fast) == pytest.approx((100.0, 80.0))
    grid = route_grid(1000.0)
    assert passing_rmse_s(slow, fast) == pytest.approx(np.sqrt(np.mean((grid / 10.0 - grid / 12.5) ** 2)))


def test_only_the_stretch_that_both_have_driven_counts():
    whole, part = passing(10.0, 300.0), passing(8.0, 300.0)
    part[:5] = np.nan
    part[15:] = np.nan
    assert speed_rmse_mps(whole, part) == pytest.approx(2.0)
    assert travel_times_s(whole, part) == pytest.approx((45.0, 56.25))
    part[8:] = np.nan
    assert np.isnan(speed_rmse_mps(whole, part))


def drives(speeds_mps: np.ndarray) -> ObservedDrives:
    times = np.asarray([passing(speed, 300.0) for speed in speeds_mps.ravel()])
    shape = speeds_mps.shape
    return ObservedDrives(np.zeros((*shape, 1)), {}, times.reshape(*shape, -1))


@pytest.mark.parametrize(("field_mps", "is_like"), [([14.4, 15.8], True), ([9.0, 22.0], False)])
def test_a_field_like_the_simulation_is_told_from_one_unlike(field_mps: list[float], is_like: bool):
    rng = np.random.default_rng(8)
    rounds = drives(15.0 + rng.standard_normal((10, 2)))
    for one in compare_trajectories(drives(np.asarray(field_mps)), rounds).values():
        assert (one["value"] <= one["limit"]) == is_like
        assert (one["p_value"] >= 0.05) == is_like


def test_no_limit_of_a_share_is_above_one():
    """Three rounds that never meet: their scatter alone would allow more than there can be."""
    counts = np.zeros((3, 1, 240))
    counts[[0, 1, 2], 0, [3, 90, 91]] = 5.0
    of_all = {name: np.resize(counts, (3, 1, len(borders) - 1)) * 0.0 for name, borders in BORDERS.items()}
    rounds = replace(drives(np.full((3, 1), 15.0)), histograms=of_all | {"subject_speed_mps": counts})
    field = replace(drives(np.full(1, 15.0)), histograms={name: one[0] for name, one in rounds.histograms.items()})
    found = compare_distributions(field, rounds)["subject_speed_mps"]
    assert found["kolmogorov_smirnov"]["limit"] == 1.0
    assert found["wasserstein"]["limit"] > 1.0


def test_rounds_that_are_all_alike_leave_one_in_as_many_to_chance():
    """Of 20 rounds and a field any may be the one that differs: no certainty comes from a spread of 0."""
    alike = predict(np.full(20, 3.0), 4.0)
    assert alike is not None
    assert alike.p_value == pytest.approx(1.0 / 21.0)
    assert exceedance(np.full(20, 3.0), 4.0) == pytest.approx(1.0 / 21.0)
    same = predict(np.full(20, 3.0), 3.0)
    assert same is not None
    assert same.p_value == exceedance(np.full(20, 3.0), 3.0) == 1.0


MEASURES = {
    "speed": Measure("speed", "", Level.TRAFFIC, "way", "time"),
    "share": Measure("share", "", Level.TRAFFIC, "part", "time", left_out=LeftOut.BIN),
    "rare": Measure("rare", "", Level.TRAFFIC, "events", "time", observations="events"),
    "short": Percentile("short", "", Level.TRAFFIC, "bin", "time", borders=(0.0, 1.0, 2.0), share=0.01),
}
NAMES = ("way", "time", "part", "events", "bin[0]", "bin[1]")


def counted(random: np.random.Generator, *shape: int, speed: float = 20.0, events: float = 30.0) -> ObservedDrives:
    time_s = random.uniform(80.0, 120.0, shape)
    way_m = time_s * random.normal(speed, 1.0, shape)
    several = [way_m, time_s, 0.3 * time_s, random.poisson(events, shape), 0.6 * time_s, 0.4 * time_s]
    return ObservedDrives(np.stack(several, axis=-1), {}, np.zeros((*shape, 1)))


def judged(field: ObservedDrives, rounds: ObservedDrives) -> dict[str, dict[str, Any]]:
    table = compare_measures(MEASURES, NAMES, field, rounds)
    correct_together(table)
    return table


def test_bins_and_what_few_observations_show_have_no_probability():
    random = np.random.default_rng(9)
    table = judged(counted(random, 2), counted(random, 10, 2))
    assert {name for name, entry in table.items() if entry["p_value"] is not None} == {"speed", "rare"}
    assert table["share"]["interval_90"] is not None  # it is told all the same
    assert table["short"]["note"] == "rests on fewer than 5 observations in the mean"  # a hundredth of 200
    assert table["share"]["is_beyond_chance"] is None
    few = judged(counted(random, 2, events=0.3), counted(random, 10, 2, events=0.3))
    assert few["rare"]["p_value"] is None


def test_a_rare_field_is_tested_where_rounds_show_many():
    """Chosen by the field's number alone, nothing would be said of the events that it lacks."""
    random = np.random.default_rng(10)
    table = judged(counted(random, 2, events=0.0), counted(random, 10, 2))
    assert table["rare"]["is_beyond_chance"]
    assert not table["speed"]["is_beyond_chance"]


@pytest.mark.parametrize("number", [1, 3])
def test_what_is_counted_per_drive_rests_on_what_is_counted(number: int):
    """One drive, or a part of one, may show many events; none of them is as little as in rounds."""
    per_drive = {"cut_ins": Measure("cut_ins", "", Level.VEHICLE, "events", "drives")}
    random = np.random.default_rng(13)

    def seen(mean: float, *shape: int) -> ObservedDrives:
        tally = np.stack([random.poisson(mean, shape), np.full(shape, 0.5)], axis=-1).astype(float)
        return ObservedDrives(tally, {}, np.zeros((*shape, 1)))

    for field_mean, is_beyond in ((9.0, False), (60.0, True)):
        table = compare_measures(per_drive, ("events", "drives"), seen(field_mean, number), seen(9.0, 20, number))
        correct_together(table)
        assert table["cut_ins"]["is_beyond_chance"] is is_beyond
    few = compare_measures(per_drive, ("events", "drives"), seen(0.5, number), seen(0.5, 20, number))
    assert few["cut_ins"]["p_value"] is None


@pytest.mark.parametrize(("num_lacking", "is_tested"), [(1, True), (4, True), (6, False)])
def test_what_most_rounds_do_not_show_is_not_tested(num_lacking: int, is_tested: bool):
    random = np.random.default_rng(11)
    rounds = counted(random, 10, 2)
    rounds.tally[:num_lacking] = 0.0
    speed = judged(counted(random, 2), rounds)["speed"]
    assert (speed["p_value"] is not None) == is_tested
    assert speed["note"] == ("" if is_tested else "most rounds do not show it")


def test_what_the_simulation_never_shows_is_beyond_chance():
    """However the field's events come in bursts: that each of its drives shows them and no simulated one does."""
    random = np.random.default_rng(12)
    for events in (10.0, 48.0, 1200.0):
        table = judged(counted(random, 4, events=events), counted(random, 20, 4, events=0.0))
        assert table["rare"]["is_beyond_chance"]
        assert table["rare"]["note"] == "shown by 4 of 4 drives of the field, 0 of 80 simulated"
    # one drive's burst says nothing
    burst = counted(random, 4, events=0.0)
    burst.tally[2, NAMES.index("events")] = 60.0
    assert not judged(burst, counted(random, 20, 4, events=0.0))["rare"]["is_beyond_chance"]


def test_a_right_simulation_of_rare_events_seldom_is_beyond_chance():
    random = np.random.default_rng(14)
    p_values = [
        judged(counted(random, 4, events=0.9), counted(random, 20, 4, events=0.9))["rare"]["p_value"]
        for _ in range(300)
    ]
    tested = np.asarray([one for one in p_values if one is not None], float)
    assert len(tested) > 50  # where the field has five by chance
    assert np.mean(tested < 0.05) * len(tested) / len(p_values) <= 0.05


def test_drives_that_stand_behind_the_field_s_are_no_quick_ones():
    """All stand after 400 m of 1000 m: over what both have driven they are as fast as the field."""
    field, rounds = drives(np.full(2, 20.0)), drives(np.full((4, 2), 20.0))
    rounds.passing_s[:, 0, 9:] = np.nan
    has_left = np.ones((4, 2), bool)
    has_left[:, 0] = False
    is_cut_short = cut_short(field, rounds, has_left, end_s=600.0)
    assert is_cut_short.tolist() == [[True, False]] * 4
    table = travel_time_table(("a", "b"), field, rounds, is_cut_short)
    assert table["a"]["field_s"] == table["a"]["simulated_s"] == pytest.approx(20.0)
    assert travel_time_criterion(table).value == 0.5
    assert arrival_criterion(is_cut_short).passes is False
    # a part of the road is all that was seen of these
    nobody = cut_short(field, rounds, np.ones((4, 2), bool), end_s=600.0)
    assert not nobody.any()
    assert travel_time_criterion(travel_time_table(("a", "b"), field, rounds, nobody)).value == 1.0
    assert arrival_criterion(nobody).passes
    # the end finds these on their way, not much slower than the field's
    assert not cut_short(field, rounds, has_left, end_s=350.0).any()


def test_probabilities_are_corrected_for_all_tables():
    one = {"a": {"p_value": 0.03}, "b": {"p_value": None}}
    other = {"c": {"p_value": 0.01}}
    correct_together(one, other)
    assert (one["a"]["p_adjusted"], other["c"]["p_adjusted"]) == (0.03, 0.02)
    assert one["a"]["is_beyond_chance"]
    assert one["b"] == {"p_value": None, "p_adjusted": None, "is_beyond_chance": None}
