"""Other values of what the logs do not show, as one more explanation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from jaxcalib.diagnosis.features.features import Cell, Channel
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.silent_values import (
    FittedAnswer,
    OpenValues,
    evidence_between,
    likeliest_values,
    shared_features,
)

NUM_FEATURES = 30
IDENTITIES = (Cell(Channel.IDENTITY, "latency"), Cell(Channel.IDENTITY, "scale"))  # count as they are, however large
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"measure {number}") for number in range(NUM_FEATURES))
VALUES = np.asarray([3600.0, 1.1, 1.0, 0.3, 0.1])
LOW, HIGH = np.asarray([3000.0, 1.0, 0.2, 0.0, 0.0]), np.asarray([4000.0, 1.2, 5.0, 0.6, 2.5])
RANDOM = np.random.default_rng(4)
SLOPE, CURVE = RANDOM.normal(2.0, 3.0, (2, 2, NUM_FEATURES))  # of each feature with both silent values
GOAL = np.asarray([3600.0, 1.1, 1.0, 0.5, 1.9])


def opened(num_silent: int) -> OpenValues:
    return OpenValues(VALUES, np.arange(5) >= 5 - num_silent, LOW, HIGH)


def null(cells: tuple[Cell, ...], mean: float = 0.0, deviation: float = 1.0) -> NullModel:
    size = len(cells)
    covariance = np.eye(size)
    return NullModel(
        cells, np.full(size, mean), np.full(size, deviation), covariance, covariance, np.zeros((size, 1)), np.ones(1)
    )


def shift_at(point: np.ndarray) -> np.ndarray:
    share = ((point - VALUES) / (HIGH - LOW))[3:]
    return share @ SLOPE + share**2 @ CURVE


@pytest.mark.parametrize(("num_silent", "num_points"), [(0, 0), (1, 8), (2, 16), (3, 32), (4, 32), (5, 32)])
def test_points_are_at_least_three_for_each_coefficient(num_silent: int, num_points: int):
    assert opened(num_silent).num_points == num_points


@pytest.mark.parametrize(("num_silent", "num_points"), [(30, 128), (63, 128), (64, 0), (100, 0)])
def test_many_values_have_fewer_points_and_too_many_none(num_silent: int, num_points: int):
    values = np.ones(num_silent)
    assert OpenValues(values, values > 0.0, 0.5 * values, 2.0 * values).num_points == num_points


@pytest.mark.parametrize("num_silent", [1, 2, 3, 4])
def test_silent_values_fill_what_is_open_and_the_others_stay(num_silent: int):
    some = opened(num_silent)
    points = np.stack(some.spread(some.num_points, seed=3))
    assert len(points) == some.num_points
    np.testing.assert_array_equal(points[:, ~some.is_silent], np.tile(VALUES[~some.is_silent], (len(points), 1)))
    for number in np.flatnonzero(some.is_silent):  # one in each of equally wide parts, as a Sobol net has them
        shares = (points[:, number] - LOW[number]) / (HIGH - LOW)[number]
        np.testing.assert_array_equal(np.sort((shares * len(points)).astype(int)), np.arange(len(points)))


def test_the_same_seed_tries_the_same_values():
    one, same, other = (np.stack(opened(2).spread(16, seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.allclose(one, other)


def test_what_is_bent_is_fitted_and_without_a_move_nothing_changes():
    some = opened(2)
    points = some.spread(16, 0)
    answer = FittedAnswer.to_runs(some, points, [shift_at(point) for point in points])
    assert answer is not None
    shift, error = answer.at(GOAL)
    np.testing.assert_allclose(shift, shift_at(GOAL), atol=1e-9)
    np.testing.assert_allclose(error, 0.0, atol=1e-9)
    for told in answer.at(VALUES):
        np.testing.assert_allclose(told, 0.0, atol=1e-12)


def test_the_standard_error_is_that_of_fits_to_other_runs():
    """Runs where the values stay are as noisy as the others, and all shifts are from these."""
    some = opened(2)
    points = some.spread(32, 0)
    random = np.random.default_rng(8)
    fits = []
    for _ in range(300):
        here, *there = 1.5 * random.standard_normal((33, NUM_FEATURES))
        shifts = [shift_at(point) + noise - here for point, noise in zip(points, there, strict=True)]
        fits.append(FittedAnswer.to_runs(some, points, shifts))
    told = np.stack([fit.at(GOAL)[0] for fit in fits if fit is not None])
    error = np.stack([fit.at(GOAL)[1] for fit in fits if fit is not None])
    assert len(told) == 300
    assert told.std(axis=0).mean() == pytest.approx(float(np.sqrt((error**2).mean())), rel=0.08)
    shrunk = told.mean(axis=0) @ shift_at(GOAL) / (shift_at(GOAL) @ shift_at(GOAL))
    assert 0.9 < shrunk < 1.0


def test_a_feature_that_few_points_show_is_fitted_to_those_or_left_open():
    some = opened(2)
    points = some.spread(32, 0)
    shifts = [shift_at(point) for point in points]
    for number, shift in enumerate(shifts):
        shift[0] = np.nan if number % 2 else shift[0]
        shift[1] = shift[1] if number < 7 else np.nan  # of four coefficients
    answer = FittedAnswer.to_runs(some, points, shifts)
    assert answer is not None
    shift, error = answer.at(GOAL)
    seen = np.arange(NUM_FEATURES) != 1
    np.testing.assert_allclose(shift[seen], shift_at(GOAL)[seen], atol=1e-8)
    np.testing.assert_array_equal(np.isinf(error), ~seen)
    field = shift_at(GOAL)
    field[1] = 1e3  # whatever it is
    one = likeliest_values(answer, field, null(CELLS), 0)
    other = likeliest_values(answer, np.where(seen, field, -1e3), null(CELLS), 0)
    np.testing.assert_array_equal(one[0], other[0])
    assert one[1] == other[1] > 10.0


def test_too_few_runs_fit_nothing():
    some = opened(2)
    points = some.spread(16, 0)
    assert FittedAnswer.to_runs(some, [], []) is None
    assert FittedAnswer.to_runs(some, points[:4], [shift_at(point) for point in points[:4]]) is None
    assert FittedAnswer.to_runs(some, points[:1] * 9, [shift_at(points[0])] * 9) is None


def test_values_that_explain_the_drives_are_found():
    some = opened(2)
    points = some.spread(16, 0)
    shifts = [shift_at(point) + 0.3 * RANDOM.standard_normal(NUM_FEATURES) for point in points]
    answer = FittedAnswer.to_runs(some, points, shifts)
    assert answer is not None
    field = shift_at(GOAL) + RANDOM.standard_normal(NUM_FEATURES)
    found, gain = likeliest_values(answer, field, null(CELLS), 0)
    np.testing.assert_array_equal(found[:3], VALUES[:3])
    np.testing.assert_allclose((found - GOAL)[3:] / (HIGH - LOW)[3:], 0.0, atol=0.25)
    assert gain > 10.0


@pytest.mark.parametrize(("num_silent", "size"), [(1, 3.0), (2, 1.0), (4, 0.3)])
def test_chance_seldom_moves_anything(num_silent: int, size: float):
    """Features answer to nothing, runs differ by chance, and the drives are far away."""
    some, random = opened(num_silent), np.random.default_rng(11)
    gains = []
    for seed in range(20):
        points = some.spread(some.num_points, seed)
        shifts = list(
            size * (random.standard_normal((len(points), NUM_FEATURES)) - random.standard_normal(NUM_FEATURES))
        )
        answer = FittedAnswer.to_runs(some, points, shifts)
        assert answer is not None
        gains.append(likeliest_values(answer, 3.0 * random.standard_normal(NUM_FEATURES), null(CELLS), seed)[1])
    assert np.mean(np.asarray(gains) > 5.0) <= 0.1


def test_evidence_between_is_that_of_normal_densities_of_the_values():
    values = np.asarray([1.4, -2.0])
    one, other = null(IDENTITIES, 1.0, 0.5), null(IDENTITIES[::-1], -1.0, 3.0)
    of_one, of_other = one.standardised(values), other.standardised(values[::-1])
    expected = norm.logpdf(values, 1.0, 0.5).sum() - norm.logpdf(values, -1.0, 3.0).sum()
    assert evidence_between(one, of_one, other, of_other) == pytest.approx(expected)
    assert evidence_between(other, of_other, one, of_one) == pytest.approx(-expected)


def test_evidence_between_leaves_out_what_one_of_them_lacks():
    one, other = null(IDENTITIES, 1.0), null(IDENTITIES[:1], 0.0)
    assert shared_features(one, other) == shared_features(other, one) == [IDENTITIES[0]]
    expected = norm.logpdf(1.4, 1.0) - norm.logpdf(1.4, 0.0)
    found = evidence_between(one, one.standardised(np.asarray([1.4, 9.0])), other, np.asarray([1.4]))
    assert found == pytest.approx(expected)


def test_densities_of_bent_differences_are_densities():
    """Far differences count by their logarithm; the density of the value still integrates to one."""
    cell = (CELLS[0],)
    grid = np.sinh(np.linspace(-12.0, 12.0, 40_001))
    flat = replace(null(cell), deviation=np.asarray([0.7]))
    wide = null(cell, deviation=1e5)
    values = grid[::20, None]
    logs = np.asarray([evidence_between(flat, flat.standardised(v), wide, wide.standardised(v)) for v in values])
    at_wide = norm.logpdf(grid[::20], 0.0, 1e5)
    assert np.trapezoid(np.exp(logs + at_wide), grid[::20]) == pytest.approx(1.0, rel=0.01)
