import numpy as np
import pytest

from jaxcalib.calibration.objective.accuracy import (
    MOES,
    VEHICLE_LEVEL,
    Effectiveness,
    cut_in_error,
    effectiveness,
    mean_errors,
    noise_floor,
    vehicle_level_of,
)
from jaxcalib.calibration.objective.bootstrap import bootstrap_errors, interval_of
from jaxcalib.measures.measure import Measure, Moe
from jaxcalib.measures.registry import judged_measures

MEASURES = {
    name: Measure(name, "", moe.level, f"{name}.sum", f"{name}.count", moe=moe)
    for name, moe in zip(judged_measures(), Moe, strict=True)
}
NAMES = tuple(f"{name}.{part}" for name in MEASURES for part in ("sum", "count"))


def tally(values: dict[str, float], default: float = 3.0) -> np.ndarray:
    """Return tallies of one observation of each measure; none of those whose value is nan."""
    pairs = [(values.get(name, default), 1.0) for name in MEASURES]
    return np.asarray([part for value, count in pairs for part in ((0.0, 0.0) if np.isnan(value) else (value, count))])


def test_relative_errors_and_their_sum():
    field = tally({"subject_time_headway_s": 2.0, "cut_ins_per_drive": 6.0})
    simulated = tally({"subject_time_headway_s": 2.3, "traffic_speed_mps": 2.7, "cut_ins_per_drive": 7.5})
    found = effectiveness(MEASURES, NAMES, field, simulated)
    assert found.errors["subject_time_headway"] == pytest.approx(0.15)
    assert found.errors["traffic_speed"] == pytest.approx(0.1)
    assert found.errors["cut_ins"] == pytest.approx(1.5 / 3.0)  # half of the field's six is the upper bound
    assert found.vehicle_level == pytest.approx(0.15 + 0.5)


def test_what_the_field_never_shows_is_left_out_and_says_so():
    found = effectiveness(MEASURES, NAMES, tally({"subject_restricted_target_gap_m": np.nan}), tally({}))
    assert found.errors["subject_lane_change_distance"] is None
    assert "never observed" in found.notes["subject_lane_change_distance"]


def test_what_only_the_simulation_never_shows_is_an_error_of_one():
    found = effectiveness(MEASURES, NAMES, tally({}), tally({"subject_restricted_target_gap_m": np.nan}))
    assert found.errors["subject_lane_change_distance"] == 1.0


@pytest.mark.parametrize(
    ("field", "simulated", "error"), [(0.0, 0.0, 0.0), (0.0, 0.4, 0.4), (1.2, 3.2, 1.0), (8.0, 7.0, 0.25)]
)
def test_cut_in_error_has_a_bound_of_at_least_one(field: float, simulated: float, error: float):
    assert cut_in_error(field, simulated) == pytest.approx(error)


def test_noise_floor_is_zero_without_noise_and_grows_with_it():
    drive = np.arange(12) % 3
    same = np.stack([tally({}) for _ in range(12)])
    errors = mean_errors(noise_floor(MEASURES, NAMES, same, drive, 20))
    assert all(errors[name] == 0.0 for name in VEHICLE_LEVEL)
    rng = np.random.default_rng(4)
    noisy = np.stack([tally({"traffic_speed_mps": 3.0 + 0.3 * rng.standard_normal()}) for _ in range(12)])
    floor = mean_errors(noise_floor(MEASURES, NAMES, noisy, drive, 50))["traffic_speed"]
    assert floor is not None
    assert 0.02 < floor < 0.12  # mean absolute error of a mean of 3 with a deviation of 10 % is about 5 %


def test_samples_of_two_simulations_draw_the_same_drives():
    """Against the field 2, 3 and 4 the errors of 3.3 and 3.6 differ by 0.3 / mean, whichever drives are drawn."""
    field = np.stack([tally({"traffic_speed_mps": speed}) for speed in (2.0, 3.0, 4.0)])
    near, far = (np.stack([tally({"traffic_speed_mps": speed})] * 5) for speed in (4.3, 4.6))
    after, before = (bootstrap_errors(MEASURES, NAMES, field, runs, 100) for runs in (near, far))
    change = after["traffic_speed"] - before["traffic_speed"]
    assert len(np.unique(after["traffic_speed"].round(6))) > 3
    assert ((change > -0.3 / 2.0 - 1e-6) & (change < -0.3 / 4.0 + 1e-6)).all()
    low_high = interval_of(change, 3)
    assert low_high is not None
    assert low_high[1] < 0.0
    assert interval_of(np.full(4, np.nan), 3) is None
    assert interval_of(change, 1) is None


def test_interval_of_few_drives_holds_the_truth_as_often_as_it_says():
    """Means of six normal numbers; the plain percentile interval holds the truth in 81 % of these."""
    rng = np.random.default_rng(8)
    drives = rng.standard_normal((600, 6)) + 2.7
    held = plain = 0
    for drive in drives:
        means = drive[rng.integers(0, 6, (1000, 6))].mean(axis=1)
        low, high = interval_of(means, 6) or (np.nan, np.nan)
        held += low <= 2.7 <= high
        low, high = np.quantile(means, [0.05, 0.95])
        plain += low <= 2.7 <= high
    assert abs(held / 600 - 0.9) < 4.0 * np.sqrt(0.9 * 0.1 / 600)
    assert plain / 600 < 0.85


def test_an_error_that_the_field_never_shows_has_no_samples():
    field = np.stack([tally({"subject_restricted_target_gap_m": np.nan})] * 3)
    samples = bootstrap_errors(MEASURES, NAMES, field, np.stack([tally({})] * 4), 20)
    assert np.isnan(samples["subject_lane_change_distance"]).all()
    assert np.isfinite(samples["vehicle_level"]).all()


def test_the_sum_of_simulated_sets_has_the_terms_that_the_field_has():
    seen = Effectiveness({name: 0.1 for name in MOES} | {VEHICLE_LEVEL[2]: None}, {})
    whole = Effectiveness({name: 0.2 for name in MOES}, {})
    lacking = Effectiveness({name: 0.2 for name in MOES} | {VEHICLE_LEVEL[0]: None}, {})
    (found,) = vehicle_level_of([whole, lacking], seen)
    assert found == pytest.approx(0.2 * (len(VEHICLE_LEVEL) - 1))
    assert vehicle_level_of([lacking], seen) == []
