"""How one driver differs, for good or for a while, from the parameters of his class."""

from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.vehicle.car_following_model import CarFollowingModel

Value = Float[Array, "..."]
Model = TypeVar("Model", bound=CarFollowingModel)


class Habits(eqx.Module):
    """Factors on the parameters of a car-following model; 1 changes no bit."""

    time_gap: Value  # factor on the desired time gap
    acceleration: Value  # factor on the acceleration
    deceleration: Value  # factor on the deceleration that the driver is ready to use

    @classmethod
    def usual(cls, like: Array) -> "Habits":
        """Return factors of 1."""
        one = jnp.ones_like(like)
        return cls(one, one, one)


HABIT_OF_FIELD = {
    "time_gap_s": "time_gap",
    "max_acceleration_mps2": "acceleration",
    "max_deceleration_mps2": "deceleration",
}  # of the fields that all models have


def with_habits(model: Model, habits: Habits) -> Model:
    """Return the model with the parameters of each driver."""
    names = model.habit_fields
    old = [getattr(model, name) for name in names]
    new = [getattr(model, name) * getattr(habits, habit) for name, habit in names.items()]
    return eqx.tree_at(lambda m: [getattr(m, name) for name in names], model, new) if old else model
