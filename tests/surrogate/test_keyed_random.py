import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.keyed_random import Purpose, exponential, random_bits, uniform

NUM_DRAWS = 200_000
VEHICLES = jnp.arange(17, 17 + NUM_DRAWS, dtype=jnp.int32)
STANDARD_ERROR = 1.0 / np.sqrt(12.0 * NUM_DRAWS)


def drawn(seed: int = 5, vehicle: int = 1234567, step: int = 42, purpose: Purpose = Purpose.FLOW) -> float:
    return float(uniform(jnp.asarray(seed), jnp.asarray(vehicle), step, purpose))


def test_the_same_key_gives_the_same_number_alone_and_in_an_array() -> None:
    together = np.asarray(uniform(jnp.asarray(5), VEHICLES, 42, Purpose.FLOW))
    for place in (0, 7, NUM_DRAWS - 1):
        assert drawn(vehicle=int(VEHICLES[place])) == together[place]
        assert drawn(vehicle=int(VEHICLES[place])) == drawn(vehicle=int(VEHICLES[place]))


@pytest.mark.parametrize(
    "change", [{"seed": 6}, {"vehicle": 1234568}, {"step": 43}, *({"purpose": p} for p in Purpose if p != Purpose.FLOW)]
)
def test_a_change_of_one_key_changes_the_number(change: dict[str, int]) -> None:
    assert drawn(**change) != drawn()


def test_steps_may_be_numbers_or_arrays() -> None:
    steps = jnp.asarray([3, 42, 7000])
    together = np.asarray(uniform(jnp.asarray(5), jnp.asarray(1234567), steps, Purpose.CAR_FOLLOWING))
    assert together.tolist() == [drawn(step=int(step), purpose=Purpose.CAR_FOLLOWING) for step in steps]


@pytest.mark.parametrize("purpose", list(Purpose))
def test_numbers_are_uniform_in_the_open_interval(purpose: Purpose) -> None:
    numbers = np.asarray(uniform(jnp.asarray(3), VEHICLES, 9, purpose), np.float64)
    assert 0.0 < numbers.min() < 1e-4
    assert 1.0 - 1e-4 < numbers.max() < 1.0
    assert abs(numbers.mean() - 0.5) < 4.0 * STANDARD_ERROR
    assert abs(numbers.var() - 1.0 / 12.0) < 4.0 * np.sqrt(1.0 / 180.0 / NUM_DRAWS)
    share = np.histogram(numbers, bins=20, range=(0.0, 1.0))[0] / NUM_DRAWS
    np.testing.assert_allclose(share, 0.05, atol=4.5 * np.sqrt(0.05 * 0.95 / NUM_DRAWS))


def test_logarithms_of_a_million_numbers_are_finite_and_negative() -> None:
    numbers = np.asarray(uniform(jnp.asarray(1), jnp.arange(1 << 20, dtype=jnp.int32), 0, Purpose.ARRIVAL))
    assert numbers.min() >= 2.0**-24
    assert numbers.max() <= 1.0 - 2.0**-24
    assert np.isfinite(np.log(numbers)).all()
    assert np.log(numbers).max() < 0.0


@pytest.mark.parametrize("lag", [1, 2, 64, 1 << 12])
def test_neighbouring_vehicles_draw_independent_numbers(lag: int) -> None:
    numbers = np.asarray(uniform(jnp.asarray(3), VEHICLES, 9, Purpose.CAR_FOLLOWING), np.float64)
    correlation = np.corrcoef(numbers[:-lag], numbers[lag:])[0, 1]
    assert abs(correlation) < 4.5 / np.sqrt(NUM_DRAWS)


@pytest.mark.parametrize("other", [{"seed": 4}, {"step": 10}, {"purpose": Purpose.FLOW}])
def test_the_numbers_of_two_seeds_steps_or_purposes_are_independent(other: dict[str, int]) -> None:
    keys = {"seed": 3, "step": 9, "purpose": Purpose.CAR_FOLLOWING}

    def draw(seed: int, step: int, purpose: Purpose) -> np.ndarray:
        return np.asarray(uniform(jnp.asarray(seed), VEHICLES, step, purpose), np.float64)

    correlation = np.corrcoef(draw(**keys), draw(**(keys | other)))[0, 1]
    assert abs(correlation) < 4.5 / np.sqrt(NUM_DRAWS)


def test_every_bit_is_set_half_of_the_time() -> None:
    bits = np.asarray(random_bits(jnp.asarray(8), VEHICLES, 1, Purpose.FLOW))
    share = [(bits >> bit & 1).mean() for bit in range(32)]
    np.testing.assert_allclose(share, 0.5, atol=4.5 * 0.5 / np.sqrt(NUM_DRAWS))


def test_exponential_numbers_have_mean_and_variance_one() -> None:
    numbers = np.asarray(exponential(jnp.asarray(3), VEHICLES, 0, Purpose.ARRIVAL), np.float64)
    assert numbers.min() > 0.0
    assert abs(numbers.mean() - 1.0) < 4.0 / np.sqrt(NUM_DRAWS)
    assert abs(numbers.var() - 1.0) < 4.0 * np.sqrt(8.0 / NUM_DRAWS)
