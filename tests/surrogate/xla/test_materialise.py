"""Values that are computed once keep their values, and are computed once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.xla.materialise import compiler_options, materialise

START = jnp.asarray([0.3, -1.7, 2.9], jnp.float32)


def long_way(values: jax.Array) -> jax.Array:
    for factor in range(1, 21):
        values = jnp.sin(values) * factor + values
    return values


def used_thrice(values: jax.Array, is_materialised: bool) -> tuple[jax.Array, ...]:
    shared = long_way(values)
    if is_materialised:
        shared = materialise(shared)
    return shared + 1.0, shared * values, jnp.where(shared > 0.0, shared, values)


def products_in(is_materialised: bool) -> int:
    program = jax.jit(lambda values: used_thrice(values, is_materialised)).lower(START).compile(compiler_options())
    return program.as_text().count(" multiply(")


def test_neither_values_nor_slopes_change() -> None:
    plain, marked = used_thrice(START, False), used_thrice(START, True)
    for one, other in zip(plain, marked, strict=True):
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other))
    slope = jax.grad(lambda values: jnp.sum(used_thrice(values, True)[1]))(START)
    np.testing.assert_allclose(slope, jax.grad(lambda values: jnp.sum(used_thrice(values, False)[1]))(START), rtol=1e-6)


def test_the_compiler_does_not_repeat_what_is_marked() -> None:
    """Guards the compiler option: should XLA rename the pass, this is where it shows."""
    if jax.default_backend() == "cpu":
        assert products_in(True) < 0.6 * products_in(False)


@pytest.mark.parametrize("num_values", [3, 5003])
def test_what_is_marked_may_lie_in_a_loop(num_values: int) -> None:
    """Guards the compiler option: XLA ends the process where it makes one function of a loop with marks.

    It takes loops for small enough up to 1024 bytes before jaxlib 0.12, and up to 1e9 bytes since.
    """
    start = jnp.linspace(0.3, 1.7, num_values)

    def many_steps(values: jax.Array, num_steps: int) -> jax.Array:
        return jax.lax.fori_loop(0, num_steps, lambda _, now: materialise((now * 0.5, now))[0] + now, values)

    program = jax.jit(many_steps).lower(start, 4).compile(compiler_options())
    np.testing.assert_allclose(program(start, 4), 1.5**4 * start, rtol=1e-6)
