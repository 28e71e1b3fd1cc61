"""Random numbers that are a pure function of (seed, vehicle, step, purpose).

A parameter set that lets a vehicle enter one step later must not shift the random numbers of every other vehicle:
only then are two parameter sets compared under common random numbers. So there is no generator state here; each draw
hashes its four keys. The mixer is the 32-bit finaliser "lowbias32" (C. Wellons, 2018, found by search over
multiply-xorshift hashes; bias 0.17), applied once per key.
"""

import enum

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt32


class Purpose(enum.IntEnum):
    """What a random number decides; two purposes never share a draw."""

    ARRIVAL = 1
    FLOW = 2
    SPEED_FACTOR = 3
    CAR_FOLLOWING = 4
    ACTION_PHASE = 5
    PERCEPTION_ERROR = 6
    TRAIT = 7
    HEAVY = 8
    PLATOON = 9
    RUBBERNECK = 10
    DISTANCE_NOISE = 11
    SPEED_NOISE = 12
    DROPOUT = 13
    DEPART_LANE = 14
    DEPART_POSITION = 15
    DEPART_SPEED = 16


def _mix(bits: UInt32[Array, "..."]) -> UInt32[Array, "..."]:
    bits = bits ^ (bits >> 16)
    bits = bits * jnp.uint32(0x7FEB352D)
    bits = bits ^ (bits >> 15)
    bits = bits * jnp.uint32(0x846CA68B)
    return bits ^ (bits >> 16)


def random_bits(
    seed: Int[Array, "..."], vehicle: Int[Array, "..."], step: Int[Array, "..."] | int, purpose: Purpose
) -> UInt32[Array, "..."]:
    """Return 32 random bits for each (seed, vehicle, step, purpose); the keys broadcast."""
    bits = _mix(jnp.asarray(seed).astype(jnp.uint32) ^ jnp.uint32(0x9E3779B9 * int(purpose) & 0xFFFFFFFF))
    bits = _mix(bits + jnp.asarray(step).astype(jnp.uint32) * jnp.uint32(0x85EBCA6B))
    return _mix(bits ^ (jnp.asarray(vehicle).astype(jnp.uint32) * jnp.uint32(0xC2B2AE35) + jnp.uint32(0x27D4EB2F)))


def uniform(
    seed: Int[Array, "..."], vehicle: Int[Array, "..."], step: Int[Array, "..."] | int, purpose: Purpose
) -> Float[Array, "..."]:
    """Return uniform random numbers in the open interval (0, 1), with 23 bits each.

    Both ends are excluded so that a logarithm or a normal quantile of the result is finite.
    """
    bits = random_bits(seed, vehicle, step, purpose)
    return ((bits >> 9).astype(jnp.float32) + 0.5) * jnp.float32(2.0**-23)


def roughly_normal(
    seed: Int[Array, "..."], vehicle: Int[Array, "..."], step: Int[Array, "..."] | int, purpose: Purpose
) -> Float[Array, "..."]:
    """Return numbers of mean 0 and variance 1, nearly normal up to 2 and never beyond 3.5.

    The sum of the four bytes of a hash: enough, and six times cheaper than a normal quantile, where many are summed up.
    """
    bits = random_bits(seed, vehicle, step, purpose)
    total = sum((bits >> shift) & 0xFF for shift in (0, 8, 16, 24))
    return (jnp.asarray(total).astype(jnp.float32) - 510.0) * jnp.float32((4.0 * (256.0**2 - 1.0) / 12.0) ** -0.5)


def exponential(
    seed: Int[Array, "..."], vehicle: Int[Array, "..."], step: Int[Array, "..."] | int, purpose: Purpose
) -> Float[Array, "..."]:
    """Return exponential random numbers with mean 1."""
    return -jnp.log(uniform(seed, vehicle, step, purpose))
