"""Stretches of pairs stand for the pairs when points are compared."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.pair_fitting.batch import PIECE_STEPS, bounds_of, misfit, pair_batch
from jaxcalib.pair_fitting.recorded_pairs import RecordedPair
from jaxcalib.pair_fitting.stretches import MOST_STRETCHES, stretches_of
from surrogate.car_following.registry import car_following_model


def wavy_pair(name: str, num_steps: int) -> RecordedPair:
    time_s = 0.1 * np.arange(num_steps)
    speed = 11.0 + 4.0 * np.sin(time_s / 9.0)
    return RecordedPair(name, speed, speed + 0.3 * np.cos(time_s / 5.0), 17.0 + 3.0 * np.sin(time_s / 13.0))


def test_short_pairs_are_one_stretch_and_cost_what_they_are_worth() -> None:
    """A pair that is one stretch has the misfit of the whole: the weight undoes the stretch's own scale."""
    pairs = [wavy_pair("a", 300), wavy_pair("b", 700)]
    found = stretches_of(pairs)
    assert [len(part) for part in found.parts] == [300, 700]
    assert found.weight == pytest.approx([1.0, 1.0])
    entry = car_following_model("idm")
    bounds = bounds_of(entry)
    units = jnp.asarray(np.random.default_rng(5).random((len(entry.parameters) + 1, 3, 2)), jnp.float32)
    whole = np.asarray(misfit(entry, bounds, units, pair_batch(pairs)))
    parts = np.asarray(misfit(entry, bounds, units, pair_batch(found.parts)), float)
    assert found.summed(parts) == pytest.approx(whole, rel=1e-6)


def test_stretches_of_a_long_pair_are_spread_over_all_of_it() -> None:
    pair = wavy_pair("long", 20 * PIECE_STEPS)
    found = stretches_of([wavy_pair("short", 200), pair])
    parts = [part for part, owner in zip(found.parts, found.pair, strict=True) if owner == 1]
    assert len(parts) == MOST_STRETCHES
    middles = [np.flatnonzero(pair.gap_m == part.gap_m[len(part) // 2])[0] / len(pair) for part in parts]
    # the fourths of the pair each have one: their middles are those of the fourths to half a stretch
    assert middles == pytest.approx([0.125, 0.375, 0.625, 0.875], abs=0.5 / 20 + 0.01)


def test_stretches_that_cover_a_pair_weigh_one_together() -> None:
    pair = wavy_pair("three", 3 * PIECE_STEPS + 17)
    found = stretches_of([pair])
    assert sum(len(part) for part in found.parts) == len(pair)
    assert found.weight.sum() == pytest.approx(1.0)
    sums = found.summed(np.asarray([[1.0, 2.0, 4.0], [0.0, 1.0, 0.0]]))
    assert sums[:, 0] == pytest.approx([found.weight @ [1.0, 2.0, 4.0], found.weight[1]])
