"""Derivatives of a replay by automatic differentiation against central differences, in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.registry import CAR_FOLLOWING_MODELS
from surrogate.car_following.replay import ReplayStart, replay
from surrogate.vehicle.model_entry import ModelEntry

STEP_S = 0.1
TIME_S = STEP_S * np.arange(200)
LEADER_MPS = 12.0 + 3.0 * np.sin(TIME_S / 3.1) - 0.05 * TIME_S
DIFFERENCE = 1e-6  # of a parameter's range


def gap_error(entry: ModelEntry, values: jnp.ndarray) -> jnp.ndarray:
    """Return what a calibration of a pair minimises: mean square departure from a given gap."""
    model = entry.build({one.name: values[place] for place, one in enumerate(entry.parameters)})
    start = ReplayStart(*(jnp.asarray([value]) for value in (11.3, 0.12, 19.7, 0.2, 27.0)))
    _, states = replay(model, start, jnp.asarray(LEADER_MPS)[:, None], jnp.full(1, 0.37), STEP_S)
    return jnp.mean((states.gap_m[:, 0] - 18.0 - 0.7 * jnp.sin(jnp.asarray(TIME_S))) ** 2)


@pytest.mark.parametrize("entry", CAR_FOLLOWING_MODELS, ids=lambda entry: entry.name)
def test_exact_derivatives_agree_with_central_differences(entry: ModelEntry) -> None:
    spread = np.asarray([one.upper - one.lower for one in entry.parameters])
    usual = np.asarray([one.usual for one in entry.parameters])
    values = usual + 0.013 * spread * np.where(np.arange(len(usual)) % 2, -1.0, 1.0)
    values = np.clip(values, *zip(*[(one.lower, one.upper) for one in entry.parameters], strict=True))
    with jax.enable_x64():
        error = jax.jit(lambda theta: gap_error(entry, theta))
        exact = np.asarray(jax.jit(jax.grad(error))(jnp.asarray(values)))
        central = []
        for place, width in enumerate(spread):
            step = np.zeros(len(values))
            step[place] = DIFFERENCE * width
            central.append(float(error(values + step) - error(values - step)) / (2.0 * DIFFERENCE * width))
    scale = np.abs(central * spread).max()
    assert scale > 0.1
    np.testing.assert_allclose(exact * spread, np.asarray(central) * spread, rtol=1e-6, atol=1e-6 * scale)
