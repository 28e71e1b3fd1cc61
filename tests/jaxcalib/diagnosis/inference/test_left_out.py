"""Sets of drives that are left out, and noise as wide as they scatter."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, null_model
from jaxcalib.diagnosis.inference.left_out import (
    FEWEST_RUNS,
    NUM_SPLITS,
    SETS_PER_SPLIT,
    differences_of,
    left_out_sets,
    noise_factor,
    with_noise,
)

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
    return with_noise(built(plain), noise_factor(left_out_sets(plain, NUM_FIELD, built)))


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

    told = with_noise(narrow(plain), noise_factor(left_out_sets(plain, NUM_FIELD, narrow)))
    assert mean_square(told) == pytest.approx(1.0, abs=0.2)


def test_what_varies_in_a_few_runs_only_has_the_noise_of_all_where_it_does_not():
    plain = drives(48, 2)
    plain.above[:, 0] = MEAN[0] + 0.1 * (np.arange(48) == 7)
    whole = built(plain)

    def of_rest(some: DriveTallies) -> NullModel:
        below, error = np.full(NUM_FEATURES, float(NUM_FIELD)), np.full((NUM_FEATURES, NUM_PARAMETERS), 0.2)
        return null_model(
            CELLS, below, some, SLOPE, error, np.ones(NUM_PARAMETERS), None, NUM_FIELD, whole.deviation
        )  # fmt: skip

    sets = left_out_sets(plain, NUM_FIELD, of_rest)
    without = [each for each in sets if each.null.deviation[0] == whole.deviation[0]]
    assert 0 < len(without) < len(sets)  # drive 7 is left out in some
    for each in sets:
        np.linalg.cholesky(each.null.noise)
        assert np.abs(each.differences[..., 0]).max() < 20.0
    assert np.isfinite(noise_factor(sets))


def test_what_parameters_leave_open_stays():
    plain = drives(48, 2)
    before, after = built(plain), measured(plain)
    assert not np.allclose(before.noise, after.noise)
    assert np.allclose(before.covariance - before.noise, after.covariance - after.noise)
    assert np.array_equal(before.deviation, after.deviation)


def test_drives_of_one_run_are_left_out_together_and_each_set_has_one_of_each_run():
    run = np.repeat(np.arange(16), 3)
    shared, seen = drives(48, 6, run), []
    shared.above[:, 0] = run  # a feature that tells runs apart

    def noted(some: DriveTallies) -> NullModel:
        assert some.run is not None
        seen.append(set(some.run.tolist()))
        return built(some)

    splits = left_out_sets(shared, NUM_FIELD, noted)
    assert len(splits) == len(seen) == NUM_SPLITS
    assert {len(each) for each in seen} == {16 - NUM_FIELD}
    assert len({tuple(sorted(each)) for each in seen}) > 1
    for each, rest in zip(splits, seen, strict=True):
        assert each.differences.shape == (SETS_PER_SPLIT, 1 + NUM_FIELD, NUM_FEATURES)
        of_runs = each.differences[:, 0, 0] * each.null.deviation[0]
        left = np.mean([number for number in range(16) if number not in rest]) - np.mean(list(rest))
        assert np.ptp(of_runs) < 1e-9  # one of each run, whichever it is
        assert np.sign(of_runs[0]) == np.sign(left)
        assert np.ptp(each.differences[:, 0, 1]) > 0.0


def test_a_field_larger_than_half_of_the_runs_is_scaled():
    plain, squares = drives(48, 6), []
    for each in left_out_sets(plain, 40, built):
        assert each.differences.shape[1] == 1 + 24
        squares.append(np.mean(each.differences[:, 0] ** 2))
    of_field = np.mean(left_out_sets(plain, 24, built)[0].differences[:, 0] ** 2)
    assert np.mean(squares) == pytest.approx(of_field, rel=0.3)


def test_drives_without_one_scatter_as_much_as_all_do():
    null, ratios = built(drives(400, 9)), []
    for seed in range(40):
        whole, *without = differences_of(drives(NUM_FIELD, 100 + seed), null, 1.0 / 400)
        assert len(without) == NUM_FIELD
        ratios.append(np.mean(np.square(without)) / np.mean(whole**2))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(whole, null.standardised(drives(NUM_FIELD, 139).values()))
    alone = differences_of(drives(1, 3), null, 1.0 / 400)
    assert alone.shape == (1, NUM_FEATURES)


def test_features_that_drives_or_runs_lack_count_as_expected():
    plain = drives(48, 7)
    plain.above[8:, 3] = plain.below[8:, 3] = 0.0  # seen in a few runs: some splits lack it, and some sets
    assert np.isfinite(measured(plain).noise).all()
    field = drives(NUM_FIELD, 4)
    field.below[:3, 7] = field.below[4:, 7] = field.above[:3, 7] = field.above[4:, 7] = 0.0  # one drive shows it
    difference = differences_of(field, built(drives(48, 8)), 0.02)
    assert difference[4, 7] == 0.0
    assert difference[3, 7] != 0.0


def test_with_hardly_any_run_nothing_can_be_left_out():
    few = drives(12, 4, np.repeat(np.arange(FEWEST_RUNS - 1), 3))
    assert left_out_sets(few, NUM_FIELD, built) == ()
    assert noise_factor(()) == 1.0
