"""How far a gap shrinks, on made-up held-out drives of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import FEWEST_EFFECTIVE_RUNS, NullModel, observed_cells
from jaxcalib.diagnosis.inference.shrinkage import (
    FEWEST_DRIVES,
    Gap,
    differences_by_chance,
    floor_of_drives,
    measure_shrinkage,
)
from jaxcalib.diagnosis.runs.explained_runs import ExplainedRuns
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null(num_features=80)
SIZE = len(NULL.cells)
# the same, without directions that have hardly any noise, as `noise.shrunk_correlation` leaves it
TAME = replace(NULL, noise=0.85 * NULL.noise + 0.15 * np.eye(SIZE))
NUM_DRIVES = 4
EFFECT = 0.8 * np.random.default_rng(1).standard_normal(SIZE)
NOTHING = np.zeros(SIZE)


def tallies(shift: np.ndarray, num_drives: int, seed: int, null: NullModel = NULL) -> DriveTallies:
    """Return drives with the null's noise; four of them together have one unit of it."""
    normal = np.random.default_rng(seed).standard_normal((num_drives, len(null.cells)))
    noise = np.sqrt(NUM_DRIVES) * normal @ np.linalg.cholesky(null.noise).T
    above = null.mean + null.deviation * (shift + noise)
    return DriveTallies(null.cells, above, np.ones_like(above), np.zeros(num_drives))


def louder(num_drives: int, seed: int, shift: np.ndarray = EFFECT) -> DriveTallies:
    """Return drives around a shift with three times the noise."""
    quiet = tallies(shift, num_drives, seed, TAME)
    middle = NULL.mean + NULL.deviation * shift
    return replace(quiet, above=middle + 3.0 * (quiet.above - middle))


def shrinkage(explained: np.ndarray | None, seed: int, shift: np.ndarray = EFFECT):
    expected = {"default": -EFFECT, "recalibrated": NOTHING, "with_effect": explained, "ceiling": shift}
    simulated, fit = tallies(NOTHING, 56, 100 + seed), tallies(shift, 8, 300 + seed)
    random = np.random.default_rng(seed)
    return measure_shrinkage(tallies(shift, NUM_DRIVES, seed), NULL, simulated, expected, random, fit_drives=fit)


@pytest.mark.parametrize(("share", "closed"), [(1.0, 1.0), (0.5, 0.75), (0.0, 0.0), (-0.3, -0.69)])
def test_the_fraction_closed_is_that_of_the_squared_difference(share: float, closed: float):
    fractions, intervals = [], []
    for seed in range(40):
        one = shrinkage(share * EFFECT, seed)
        assert one.fraction_closed is not None
        assert one.interval_90 is not None
        fractions.append(one.fraction_closed)
        intervals.append(one.interval_90)
    assert np.mean(fractions) == pytest.approx(closed, abs=0.05)
    low, high = np.transpose(intervals)
    assert np.mean((low - 1e-9 <= closed) & (closed <= high + 1e-9)) >= 0.8
    assert np.mean(high - low) < 0.6


def test_the_floor_is_what_chance_makes_of_held_out_drives():
    floors = [shrinkage(None, seed) for seed in range(6)]
    by_chance = [Gap.of(NULL)(NULL.standardised(tallies(NOTHING, NUM_DRIVES, 40 + k).values())) for k in range(40)]
    # the drives' gap lacks the noise of the null runs' mean, which the floor holds: 1/56 beside 1/4
    assert np.mean([one.floor for one in floors]) == pytest.approx(np.mean(by_chance) * (1 + 4 / 56), rel=0.15)
    assert all(one.fraction_closed is None and one.interval_90 is None for one in floors)
    assert all(one.with_effect == one.recalibrated and one.ceiling <= one.recalibrated for one in floors)


def test_an_effect_that_brings_chance_is_not_blamed_for_it():
    """Drives with the effect scatter three times as far: what is left then is chance, and all of the gap is closed."""
    effect = 4.0 * EFFECT
    expected = {"default": -effect, "recalibrated": NOTHING, "with_effect": effect, "ceiling": effect}
    found = []
    for seed in range(12):
        field, null_runs = louder(NUM_DRIVES, 50 + seed, effect), tallies(NOTHING, 56, 100 + seed, TAME)
        random = np.random.default_rng(seed)
        explained, fit = ExplainedRuns(louder(400, 7, effect)), louder(8, 200 + seed, effect)
        told = measure_shrinkage(field, TAME, null_runs, expected, random, explained, fit)
        plain = measure_shrinkage(field, TAME, null_runs, expected, random)
        assert told.with_effect == pytest.approx(plain.with_effect / 9.0, rel=0.3)
        found.append((told.fraction_closed, told.floor, told.with_effect))
    told, floor, left = np.mean(found, axis=0)
    assert told == pytest.approx(1.0, abs=0.05)
    assert floor == pytest.approx(left, rel=0.25)


@pytest.mark.parametrize("num_drives", [5, 8, 12])
def test_the_floor_of_drives_that_scatter_farther_than_runs_is_theirs(num_drives: int):
    gap, random = Gap.of(TAME), np.random.default_rng(0)
    of_drives = []
    for seed in range(25):
        floor = floor_of_drives(louder(num_drives, seed), TAME, gap, NUM_DRIVES, 56, random)
        assert floor is not None
        of_drives.append(floor)
    middle = NULL.standardised(NULL.mean + NULL.deviation * EFFECT)
    seen = [gap(NULL.standardised(louder(NUM_DRIVES, 900 + k).values()) - middle) for k in range(60)]
    assert np.mean(of_drives) == pytest.approx(np.mean(seen) * (1 + NUM_DRIVES / 56), rel=0.12)
    assert floor_of_drives(louder(FEWEST_DRIVES - 1, 3), TAME, gap, NUM_DRIVES, 56, random) is None


def test_without_a_gap_there_is_no_fraction():
    found = [shrinkage(NOTHING + 0.01, seed, NOTHING) for seed in range(8)]
    assert any(one.fraction_closed is None for one in found)
    assert all((one.fraction_closed is None) == (one.interval_90 is None) for one in found)


def test_what_drives_do_not_show_counts_as_explained():
    assert Gap.of(NULL)(np.where(np.arange(SIZE) == 2, np.nan, 0.0)) == 0.0


@given(st.integers(0, 2**31), st.integers(2, 30))
def test_the_gap_does_not_depend_on_how_features_are_ordered(seed: int, size: int):
    random = np.random.default_rng(seed)
    mixing = random.standard_normal((size, size)) + 3.0 * np.eye(size)
    noise = mixing @ mixing.T + np.eye(size)
    difference, order = random.standard_normal(size), random.permutation(size)
    one = Gap(np.linalg.cholesky(noise))(difference)
    other = Gap(np.linalg.cholesky(noise[np.ix_(order, order)]))(difference[order])
    assert one == pytest.approx(other, rel=1e-8)
    assert one == pytest.approx(difference @ np.linalg.solve(noise, difference) / size, rel=1e-8)


def test_sets_of_null_runs_have_the_noise_of_as_many_drives():
    sets = differences_by_chance(tallies(NOTHING, 200, 5), NULL, NUM_DRIVES, np.random.default_rng(0))
    assert np.mean(sets**2) == pytest.approx(1.0 + NUM_DRIVES / 200, rel=0.1)


def test_an_identity_needs_few_drives_and_a_mean_needs_many():
    cells = (
        Cell(Channel.IDENTITY, "latency_by_own_change_s", role="subject", tolerance=0.05),
        Cell(Channel.REPLAY, "residual_mps2", "following"),
    )
    runs = int(2 * FEWEST_EFFECTIVE_RUNS)
    weight = np.full((runs, 2), 1e-3)
    weight[:5] = 1.0  # five runs have nearly all observations
    simulated = DriveTallies(cells, 0.1 * weight, weight, np.zeros(runs))
    field = replace(simulated, above=0.1 * weight[3:11], below=weight[3:11], depart_s=np.zeros(8))
    assert observed_cells(field, simulated) == cells[:1]


def test_a_mean_needs_many_runs_however_many_drives_share_one():
    cells = (Cell(Channel.REPLAY, "residual_mps2", "following"), Cell(Channel.REPLAY, "residual_mps2", "in a jam"))
    drives, runs = 48, 24
    weight = np.ones((drives, 2))
    weight[16:, 1] = 1e-3  # sixteen drives of eight runs are in a jam
    above = weight * (0.1 + 0.02 * np.random.default_rng(4).standard_normal(weight.shape))
    simulated = DriveTallies(cells, above, weight, np.zeros(drives), np.arange(drives) * runs // drives)
    field = DriveTallies(cells, above[:8], weight[:8], np.zeros(8))
    assert observed_cells(field, simulated) == cells[:1]
    assert observed_cells(field, replace(simulated, run=None)) == cells


def test_what_is_the_same_in_all_runs_is_no_feature():
    cells = (Cell(Channel.REPLAY, "residual_mps2", "following"), Cell(Channel.REPLAY, "residual_mps2", "in a jam"))
    weight = np.ones((24, 2))
    above = weight * (0.1 + 0.02 * np.random.default_rng(4).standard_normal(weight.shape))
    above[:, 1] = 0.2
    simulated = DriveTallies(cells, above, weight, np.zeros(24))
    assert observed_cells(simulated.take(range(8)), simulated) == cells[:1]
