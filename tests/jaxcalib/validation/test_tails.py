"""Tails of known distributions are found back from counts in classes."""

import numpy as np
import pytest
from scipy.stats import expon, genpareto

from jaxcalib.measures.safety import DRAC_BORDER_MPS2
from jaxcalib.validation.observer import ObservedDrives
from jaxcalib.validation.tails import FEWEST_EXCEEDANCES, THRESHOLD_MPS2, _survival, compare_tails, once_in_1000_km

NUM_BINS = len(DRAC_BORDER_MPS2) - 1


def counted(values: np.ndarray) -> np.ndarray:
    return np.histogram(values, DRAC_BORDER_MPS2)[0].astype(float)


@pytest.mark.parametrize("shape", [-0.2, 0.0, 0.25])
def test_the_level_of_a_known_tail(shape: float):
    random = np.random.default_rng(7)
    excess = genpareto.rvs(shape, scale=0.7, size=20_000, random_state=random)
    distance_m = 2.0e8  # 200 000 km: an exceedance each 10 km, so one in a hundred is needed once in 1000 km
    level, found = once_in_1000_km(counted(THRESHOLD_MPS2 + excess), distance_m)
    assert found == pytest.approx(shape, abs=0.05)
    assert level == pytest.approx(THRESHOLD_MPS2 + genpareto.isf(0.01, shape, scale=0.7), rel=0.05)


def test_few_exceedances_have_no_tail():
    counts = np.zeros(NUM_BINS)
    counts[0], counts[2] = 500.0, FEWEST_EXCEEDANCES - 1.0
    assert np.isnan(once_in_1000_km(counts, 1e5)).all()


def drives(random: np.random.Generator, scale: float, *shape: int) -> np.ndarray:
    """Return the parts of drives of 3 km with 10 exceedances on average, [..., part]."""
    parts = np.zeros((*shape, 2 * (NUM_BINS + 1)))
    for place in np.ndindex(shape):
        excess = expon.rvs(scale=scale, size=random.poisson(10.0), random_state=random)
        parts[place][:NUM_BINS] = parts[place][NUM_BINS + 1 : -1] = counted(THRESHOLD_MPS2 + excess)
        parts[place][[NUM_BINS, -1]] = 3000.0
    return parts


def test_intervals_hold_the_truth_and_tell_a_longer_tail():
    random = np.random.default_rng(11)
    names = tuple(
        f"{actor}_{part}"
        for actor in ("subject", "background")
        for part in (*(f"drac_bin[{index}]" for index in range(NUM_BINS)), "distance_seen_m")
    )
    rarer, held = 1e-6 / (10.0 / 3000.0), []
    for _ in range(8):
        field = ObservedDrives(drives(random, 0.5, 24), {}, np.zeros((24, 1)))
        rounds = ObservedDrives(drives(random, 0.9, 6, 24), {}, np.zeros((6, 24, 1)))
        found = compare_tails(names, field, rounds, random)["background"]
        for name, scale in (("field", 0.5), ("simulated", 0.9)):
            low, high = found[name]["interval_90"]
            held.append(low < THRESHOLD_MPS2 + expon.isf(rarer, scale=scale) < high)
        assert found["field"]["exceedances"] == field.tally[:, NUM_BINS + 3 : -1].sum()
    assert np.mean(held) > 0.7
    assert found["simulated"]["level_mps2"] > found["field"]["level_mps2"]


def test_the_survival_is_scipy_s():
    excess = np.asarray([0.0, 0.3, 1.7, 4.0])
    for shape in (-0.3, 0.0, 0.4):
        assert _survival(excess, shape, 0.8) == pytest.approx(genpareto.sf(excess, shape, scale=0.8))
