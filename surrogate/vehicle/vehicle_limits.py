"""What a vehicle can do of what its driver wants."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]
SMALLEST_SPEED_MPS = 1e-5


def next_speed_mps(speed_mps: Value, acceleration_mps2: Value, step_s: float) -> Value:
    """Return the speed after a step, >= 0; who brakes to a standstill stands, whatever rounding leaves of his speed."""
    speed = speed_mps + step_s * acceleration_mps2
    return jnp.where(speed <= SMALLEST_SPEED_MPS, 0.0, speed)  # what is no number stays none


def limited_acceleration(
    wanted_mps2: Value,
    speed_mps: Value,
    desired_speed_mps: Value,
    max_acceleration_mps2: Value,
    max_deceleration_mps2: Value,
    emergency_deceleration_mps2: Value,
    step_s: float,
) -> Value:
    """Return what a vehicle does of what its driver wants.

    It accelerates no harder than it can and not beyond the desired speed; if it is faster than that, it slows down no
    harder than it is ready to; it brakes no harder than physics allows.
    """
    up_mps2 = jnp.minimum(max_acceleration_mps2, (desired_speed_mps - speed_mps) / step_s)
    up_mps2 = jnp.maximum(up_mps2, -max_deceleration_mps2)
    return jnp.clip(wanted_mps2, -emergency_deceleration_mps2, up_mps2)
