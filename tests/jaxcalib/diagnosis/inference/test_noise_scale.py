"""The noise of a null model is as wide as runs show that had no part of it."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, null_model
from jaxcalib.diagnosis.inference.noise_scale import FEWEST_GROUPS, with_measured_noise

NUM_FEATURES, NUM_FIELD, NUM_PARAMETERS = 120, 8, 2
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"measure_{k}", "everywhere") for k in range(NUM_FEATURES))
MIXING = np.eye(NUM_FEATURES) + 0.2 * np.random.default_rng(3).standard_normal((NUM_FEATURES, NUM_FEATURES))
MEAN = 5.0 + np.linspace(-1.0, 1.0, NUM_FEATURES)
SLOPE = 0.05 * np.random.default_rng(8).standard_normal((NUM_FEATURES, NUM_PARAMETERS))


def drives(number: int, seed: int, run: np.ndarray | None = None) -> DriveTallies:
    """Return drives of correlated features with rare events, for long tails; those of one run share half of it."""
    random = np.random.default_rng(seed)
    rare = 1.0 + 5.0 * (random.random((number, NUM_FEATURES)) < 0.06)
    noise = rare * random.standard_normal((number, NUM_FEATURES))
    if run is not None:
        noise = np.sqrt(0.5) * (noise + random.standard_normal((run.max() + 1, NUM_FEATURES))[run])
    above = MEAN + 0.3 * noise @ MIXING.T
    return DriveTallies(CELLS, above, np.ones_like(above), np.zeros(number), run)


def built(some: DriveTallies) -> NullModel:
    below, error = np.full(NUM_FEATURES, float(NUM_FIELD)), np.full((NUM_FEATURES, NUM_PARAMETERS), 0.2)
    return null_model(CELLS, below, some, SLOPE, error, np.ones(NUM_PARAMETERS), None, NUM_FIELD)


def by_noise(difference: np.ndarray, null: NullModel) -> float:
    return float(difference @ np.linalg.solve(null.noise, difference))


def measured(plain: DriveTallies) -> NullModel:
    return with_measured_noise(built(plain), plain, NUM_FIELD, built)


def mean_square(null: NullModel) -> float:
    """By the noise, over fields without effect, for each feature."""
    fields = (null.standardised(drives(NUM_FIELD, 100 + seed).values()) for seed in range(60))
    return float(np.mean([by_noise(field, null) for field in fields])) / NUM_FEATURES


@pytest.mark.parametrize("seed", [0, 1])
def test_fields_that_nobody_has_seen_scatter_by_one_unit_of_noise(seed: int):
    plain = drives(48, seed)
    assert mean_square(built(plain)) < 0.7  # slopes' errors are taken at their largest
    assert mean_square(measured(plain)) == pytest.approx(1.0, abs=0.2)


def test_noise_that_is_too_narrow_becomes_wider():
    plain = drives(48, 5)

    def narrow(some: DriveTallies) -> NullModel:
        null = built(some)
        return replace(null, noise=0.1 * null.noise, covariance=null.covariance - 0.9 * null.noise)

    told = with_measured_noise(narrow(plain), plain, NUM_FIELD, narrow)
    assert mean_square(told) == pytest.approx(1.0, abs=0.2)


def test_what_parameters_leave_open_stays():
    plain = drives(48, 2)
    before, after = built(plain), measured(plain)
    assert not np.allclose(before.noise, after.noise)
    assert np.allclose(before.covariance - before.noise, after.covariance - after.noise)
    assert np.array_equal(before.deviation, after.deviation)


def test_drives_of_one_run_are_left_out_together():
    run = np.repeat(np.arange(16), 3)
    shared, seen = drives(48, 6, run), []

    def noted(some: DriveTallies) -> NullModel:
        assert some.run is not None
        seen.append(set(some.run.tolist()))
        return built(some)

    with_measured_noise(built(shared), shared, NUM_FIELD, noted)
    left_out = [set(range(16)) - each for each in seen]
    assert sorted(number for each in left_out for number in each) == list(range(16))


def test_features_that_some_runs_lack_count_as_agreeing():
    plain = drives(48, 7)
    plain.above[8:, 3] = plain.below[8:, 3] = 0.0  # seen in a few runs: some folds lack it, and some sets
    assert np.isfinite(measured(plain).noise).all()


def test_with_hardly_any_run_nothing_can_be_left_out():
    few = drives(12, 4, np.repeat(np.arange(FEWEST_GROUPS - 1), 3))
    null = built(few)
    assert with_measured_noise(null, few, NUM_FIELD, built) is null
