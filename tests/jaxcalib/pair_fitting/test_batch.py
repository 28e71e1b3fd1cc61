"""Misfits of pairs and their derivatives: cut into pieces or not, against central differences in double precision."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.pair_fitting.batch import bounds_of, misfit, misfit_and_slopes, pair_batch
from surrogate.car_following.registry import car_following_model
from tests.jaxcalib.pair_fitting.pairs import simulated_pair

STEP = 1e-6  # of the unit range, in double precision


def to_double(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float64) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree)


@pytest.mark.parametrize("model", ["idm", "krauss", "gipps", "iidm"])
def test_derivatives_agree_with_central_differences(model: str) -> None:
    entry = car_following_model(model)
    pairs = [simulated_pair("idm", "a", 230, 0.4), simulated_pair("idm", "b", 170, 1.3)]
    with jax.enable_x64(True):
        bounds, batch = to_double(bounds_of(entry)), to_double(pair_batch(pairs, piece_steps=96))
        middle = np.random.default_rng(3).uniform(0.35, 0.6, (len(entry.parameters) + 1, len(pairs)))
        found = jax.jit(lambda unit: misfit_and_slopes(entry, bounds, unit, batch))(jnp.asarray(middle))
        moved = middle[:, None] + STEP * np.concatenate([np.eye(len(middle)), -np.eye(len(middle))], axis=1)[..., None]
        total = np.asarray(jax.jit(lambda units: misfit(entry, bounds, units, batch))(jnp.asarray(moved)))
        at_middle = np.asarray(misfit(entry, bounds, jnp.asarray(middle)[:, None], batch))[0]
    slope = (total[: len(middle)] - total[len(middle) :]) / (2.0 * STEP)
    scale = np.abs(slope).max(axis=0)
    np.testing.assert_allclose(2.0 * np.asarray(found.gradient) / scale, slope / scale, atol=1e-5)
    np.testing.assert_allclose(found.total, at_middle, rtol=1e-9)


def test_pieces_and_spare_lanes_change_nothing() -> None:
    entry = car_following_model("idm")
    bounds = bounds_of(entry)
    pairs = [simulated_pair("idm", f"p{k}", 150 + 40 * k, 0.7 * k, noise_m=0.2) for k in range(3)]
    lanes = np.asarray([2, 0, 1, 1])
    unit = jnp.asarray(np.random.default_rng(1).uniform(0.2, 0.7, (len(entry.parameters) + 1, 4)), jnp.float32)
    whole = misfit_and_slopes(entry, bounds, unit, pair_batch(pairs, lanes, piece_steps=256))
    cut = misfit_and_slopes(entry, bounds, unit, pair_batch(pairs, lanes, piece_steps=64))
    jax.tree.map(np.testing.assert_array_equal, whole, cut)
    alone = misfit_and_slopes(entry, bounds, unit[:, 1:2], pair_batch(pairs[:1]))
    np.testing.assert_allclose(whole.total[1], alone.total[0], rtol=1e-5)
    assert np.ptp(np.asarray(whole.total)) > 0.0
