"""Values made of pooled tallies: quotients, deviations and percentiles, and when there are none."""

from collections.abc import Mapping

import numpy as np
import pytest

from jaxcalib.measures.drive_tally import DriveTally
from jaxcalib.measures.measure import Deviation, Level, Measure, Percentile, RestrictedMean

BORDERS = (0.0, 0.5, 1.0, 1.5, 2.5, 4.0)


def bins(values: np.ndarray) -> dict[str, float]:
    counts = np.histogram(values, BORDERS)[0]
    return {f"bin[{k}]": float(count) for k, count in enumerate(counts)} | {"all": float(len(values))}


def percentile(share: float, scale: float = 1.0) -> Percentile:
    return Percentile("p", "", Level.VEHICLE, "bin", "all", scale, borders=BORDERS, share=share)


def test_a_quotient_in_the_unit_of_its_name():
    measure = Measure("a_pkm", "", Level.VEHICLE, "sum", "count", 1000.0)
    value = measure.value({"sum": 3.0, "count": 8.0})
    assert (value.value, value.num_observations, value.reason, value.is_valid) == (375.0, 8.0, "", True)
    assert np.isnan(value.num_censored)


def test_observations_and_what_was_censored():
    measure = Measure("a", "", Level.VEHICLE, "sum", "metres", observations="events", censored="beyond")
    value = measure.value({"sum": 3.0, "metres": 8.0, "events": 5.0, "beyond": 2.0})
    assert (value.num_observations, value.num_censored) == (5.0, 2.0)
    assert measure.tallies() == ("sum", "metres", "events", "beyond")


@pytest.mark.parametrize("count", [0.0, float("nan")])
def test_what_was_never_observed_has_no_value_but_a_reason(count: float):
    measure = Measure("a", "", Level.VEHICLE, "sum", "count", censored="beyond")
    value = measure.value({"sum": 0.0, "count": count, "beyond": 7.0})
    assert np.isnan(value.value)
    assert not value.is_valid
    assert value.reason == "never observed"
    assert value.num_censored == 7.0


def test_nothing_observed_is_zero_if_there_was_something_to_observe():
    measure = Measure("lane_changes_pkm", "", Level.VEHICLE, "changes", "metres", 1000.0, observations="changes")
    value = measure.value({"changes": 0.0, "metres": 900.0})
    assert (value.value, value.num_observations, value.is_valid) == (0.0, 0.0, True)


@pytest.mark.parametrize("seed", range(4))
def test_a_deviation_is_that_of_numpy(seed: int):
    values = np.random.default_rng(seed).gamma(3.0, 0.7, 5 + 40 * seed)
    deviation = Deviation("d", "", Level.VEHICLE, "sum", "count", 3.6, squares="squares")
    tally = {"sum": values.sum(), "count": float(len(values)), "squares": (values**2).sum()}
    value = deviation.value(tally)
    assert value.value == pytest.approx(3.6 * np.std(values, ddof=1), rel=1e-9)
    assert value.num_observations == len(values)


def test_a_deviation_needs_two_observations():
    deviation = Deviation("d", "", Level.VEHICLE, "sum", "count", squares="squares")
    value = deviation.value({"sum": 2.0, "count": 1.0, "squares": 4.0})
    assert (value.is_valid, value.reason) == (False, "fewer than two observations")
    # rounding may leave less than nothing
    assert deviation.value({"sum": 3.0, "count": 3.0, "squares": 3.0 - 1e-7}).value == 0.0
    assert "squares" in deviation.tallies()


@pytest.mark.parametrize("share", [0.05, 0.15, 0.5, 0.85, 0.95])
@pytest.mark.parametrize("seed", range(3))
def test_a_percentile_is_that_of_numpy_within_its_bin(seed: int, share: float):
    values = np.random.default_rng(seed).uniform(0.0, 4.0, 500)
    found = percentile(share).value(bins(values)).value
    cumulated = np.append(0.0, np.cumsum(np.histogram(values, BORDERS)[0])) / len(values)
    assert found == pytest.approx(np.interp(share, cumulated, BORDERS), rel=1e-9)
    # between two observations of 500 there are 0.008 on average; inside a bin the values are even but for chance
    assert found == pytest.approx(np.quantile(values, share), abs=0.1)


def test_a_percentile_of_values_that_lie_evenly_is_exact():
    values = (np.arange(400) + 0.5) / 100
    for share in (0.1, 0.3, 0.5, 0.7):
        assert percentile(share).value(bins(values)).value == pytest.approx(np.quantile(values, share), abs=0.006)
    assert percentile(0.5, scale=60.0).value(bins(values)).value == pytest.approx(120.0)


def test_a_percentile_beyond_the_last_border_has_no_value():
    values = np.asarray([0.2, 0.7, 5.0, 6.0])
    assert percentile(0.5).value(bins(values)).value == pytest.approx(1.0)
    beyond = percentile(0.75).value(bins(values))
    assert (beyond.is_valid, beyond.num_observations) == (False, 4.0)
    assert "4" in beyond.reason


def test_a_percentile_passes_over_empty_bins():
    values = np.asarray([0.2, 0.3, 3.0, 3.1])
    assert percentile(0.5).value(bins(values)).value == pytest.approx(0.5)
    assert percentile(0.75).value(bins(values)).value == pytest.approx(3.25)
    assert percentile(0.5).value(bins(np.empty(0))).reason == "never observed"


def restricted(ended: list[float], censored: list[float], total: float, width: float = 10.0) -> float:
    """Return the restricted mean of a life table."""
    measure = RestrictedMean(
        "r", "", Level.VEHICLE, "ends", "all", censored="beyond", censored_classes="lost",
        num_classes=len(ended), class_width=width,
    )  # fmt: skip
    tally = {f"ends[{k}]": one for k, one in enumerate(ended)} | {f"lost[{k}]": one for k, one in enumerate(censored)}
    value = measure.value(tally | {"all": total, "beyond": sum(censored)})
    assert set(measure.tallies()) == {*tally, "all", "beyond"}
    assert (value.num_observations, value.num_censored) == (total, sum(censored))
    return value.value


def test_a_restricted_mean_without_censoring_is_that_of_the_lesser_of_value_and_limit():
    # two end between 10 and 20, one between 30 and 40, three reach the limit: in the middle of their classes on average
    assert restricted([0, 2, 0, 1], [0, 0, 0, 0], 6) == pytest.approx((2 * 15 + 35 + 3 * 40) / 6)
    assert restricted([0, 0], [0, 0], 4) == pytest.approx(20.0)
    assert np.isnan(restricted([0, 0], [0, 0], 0))


def test_a_life_table_by_hand():
    # 10 begin; class 1: 2 end, 2 censored: 2 / (10 - 1); class 2: 6 at risk, 3 end; class 3: 3 at risk, 3 censored
    after_1, after_2 = 1 - 2 / 9, (1 - 2 / 9) * 0.5
    mean = 10 * ((1 + after_1) / 2 + (after_1 + after_2) / 2 + after_2)
    assert restricted([2, 3, 0], [2, 0, 3], 10) == pytest.approx(mean)
    assert restricted([2, 3, 0, 0], [2, 0, 3, 0], 10) == pytest.approx(mean + 10 * after_2)  # nothing left at risk


@pytest.mark.parametrize("seed", range(3))
def test_a_restricted_mean_finds_what_leaving_out_the_censored_misses(seed: int):
    """Gaps of an exponential distribution, seen up to an even distance of their own."""
    rng = np.random.default_rng(seed)
    gap, seen_to = rng.exponential(60.0, 20_000), rng.uniform(20.0, 200.0, 20_000)
    seen, is_known = np.minimum(gap, seen_to), gap <= seen_to
    borders = np.arange(0.0, 150.0, 10.0)
    ended, lost = (np.histogram(seen[chosen], borders)[0].tolist() for chosen in (is_known, ~is_known))
    measure = restricted(ended, lost, len(gap))
    truth = 60.0 * (1.0 - np.exp(-140.0 / 60.0))
    assert measure == pytest.approx(truth, rel=0.02)
    assert np.minimum(gap[is_known], 140.0).mean() < 0.8 * truth


def test_every_measure_finds_its_tallies(measures: Mapping[str, Measure], tally: DriveTally):
    assert len(set(tally.names)) == len(tally.names)
    needed = {name for measure in measures.values() for name in measure.tallies()}
    assert needed <= set(tally.names)
    zero = dict.fromkeys(tally.names, 0.0)
    for measure in measures.values():
        value = measure.value(zero)
        assert not value.is_valid
        assert value.reason
