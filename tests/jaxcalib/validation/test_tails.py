"""Tails of known distributions are found back from counts in classes."""

import numpy as np
import pytest
from scipy.stats import binomtest, genpareto

from jaxcalib.measures.safety import DRAC_BORDER_MPS2
from jaxcalib.validation.observer import ObservedDrives
from jaxcalib.validation.tails import FEWEST_EXCEEDANCES, compare_tails, survival_of, tail_of, threshold_of

NUM_BINS = len(DRAC_BORDER_MPS2) - 1
THRESHOLD_MPS2 = 1.0
FIRST_BEYOND = DRAC_BORDER_MPS2.index(THRESHOLD_MPS2)
KM_PER_DRIVE, PER_DRIVE = 3.0, 10.0
RARER = KM_PER_DRIVE / 1000.0 / PER_DRIVE  # what is needed once in 1000 km is so much rarer than an exceedance


def drives(random: np.random.Generator, number: int, shape: float, scale: float, frames: int = 1) -> np.ndarray:
    """Return counts of drives whose exceedances come in runs of so many frames, [drive, class]."""
    counts = np.zeros((number, NUM_BINS))
    for row in counts:
        events = random.poisson(PER_DRIVE / frames)
        values = THRESHOLD_MPS2 + genpareto.rvs(shape, scale=scale, size=events, random_state=random)
        row[:] = frames * np.histogram(values, DRAC_BORDER_MPS2)[0]
        row[FIRST_BEYOND - 1] = 200.0  # those below the threshold
    return counts


@pytest.mark.parametrize("shape", [-0.2, 0.02, 0.25])
def test_the_level_of_a_known_tail(shape: float):
    found = tail_of(drives(np.random.default_rng(7), 2000, shape, 0.7), 2e6 * KM_PER_DRIVE, THRESHOLD_MPS2)
    assert found.shape == pytest.approx(shape, abs=0.05)
    assert found.level_mps2 == pytest.approx(THRESHOLD_MPS2 + genpareto.isf(RARER, shape, scale=0.7), rel=0.1)


@pytest.mark.parametrize(("shape", "frames"), [(-0.15, 1), (0.1, 1), (0.1, 4)])
def test_intervals_hold_the_truth_though_frames_come_in_runs(shape: float, frames: int):
    random, truth = np.random.default_rng(5), THRESHOLD_MPS2 + genpareto.isf(RARER, shape, scale=0.6)
    held, widths = [], []
    for _ in range(40):
        found = tail_of(drives(random, 24, shape, 0.6, frames), 24e3 * KM_PER_DRIVE, THRESHOLD_MPS2)
        low, high = found.interval_90_mps2
        assert low <= found.level_mps2 <= high
        held.append(low < truth < high)
        widths.append(high - low)
    assert binomtest(sum(held), len(held), 0.9, alternative="less").pvalue > 1e-2
    assert np.median(widths) < 10.0 * truth


def test_few_exceedances_have_no_tail():
    counts = np.zeros((3, NUM_BINS))
    counts[0, 0], counts[0, FIRST_BEYOND] = 500.0, FEWEST_EXCEEDANCES - 1.0
    assert np.isnan(tail_of(counts, 1e5, THRESHOLD_MPS2).level_mps2)
    counts[1, FIRST_BEYOND] = 1.0
    assert np.isfinite(tail_of(counts, 1e5, THRESHOLD_MPS2).level_mps2)
    assert np.isnan(tail_of(counts[:2], 1e5, THRESHOLD_MPS2).level_mps2)  # two drives scatter anyhow


def test_intervals_of_few_drives_hold_the_truth_as_often():
    """Four drives: with the quantile of a known dispersion 84 of 100 intervals hold it."""
    random, truth = np.random.default_rng(12), THRESHOLD_MPS2 + genpareto.isf(RARER, 0.02, scale=0.6)
    held = []
    for _ in range(250):
        low, high = tail_of(drives(random, 4, 0.02, 0.6, frames=4), 4e3 * KM_PER_DRIVE, THRESHOLD_MPS2).interval_90_mps2
        if np.isfinite(low):
            held.append(low < truth < high)
    assert len(held) > 200
    assert np.mean(held) > 0.88


def test_the_threshold_is_a_high_quantile():
    counts = np.zeros(NUM_BINS)
    counts[:3] = 80.0, 11.0, 9.0
    assert threshold_of(counts) == DRAC_BORDER_MPS2[2]
    counts[-1] = 2.0
    assert threshold_of(counts) == DRAC_BORDER_MPS2[3]


def test_field_and_simulation_are_told_by_the_field_s_threshold():
    random = np.random.default_rng(11)
    parts = [f"approach_bin[{index}]" for index in range(NUM_BINS)] + ["distance_seen_m"]
    names = tuple(f"{actor}_{part}" for actor in ("subject", "background") for part in parts)

    def observed(counts: np.ndarray, *shape: int) -> ObservedDrives:
        one = np.concatenate([counts, np.full((len(counts), 1), 1000.0 * KM_PER_DRIVE)], axis=1)
        return ObservedDrives(np.concatenate([0.0 * one, one], axis=1).reshape(*shape, -1), {}, np.zeros((*shape, 1)))

    field = drives(random, 24, 0.0, 0.5)
    longer = drives(random, 6 * 24, 0.0, 1.0)
    found = compare_tails(names, observed(field, 24), observed(longer, 6, 24))
    assert found["subject"]["field"]["level_mps2"] is None
    of_field, of_simulated = found["background"]["field"], found["background"]["simulated"]
    assert of_field["threshold_mps2"] == of_simulated["threshold_mps2"] == THRESHOLD_MPS2
    assert of_field["exceedances"] == field[:, FIRST_BEYOND:].sum()
    assert of_simulated["interval_90"][0] > of_field["level_mps2"]


def test_the_survival_is_scipy_s():
    excess = np.asarray([0.0, 0.3, 1.7, 4.0])
    for shape in (np.asarray(-0.3), np.asarray(0.4)):
        assert survival_of(excess, shape, np.asarray(0.8)) == pytest.approx(genpareto.sf(excess, shape, scale=0.8))
