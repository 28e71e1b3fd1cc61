"""What every measure is made of: a fold over scenes into named, additive tallies.

Tallies are sums and counts. They add up over frames, drives and seeds, so that several short drives pool into one
observation without storing any of them; values such as means or percentiles are made of pooled tallies at the end.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxcalib.measures.scene import Scene


class Fold(eqx.Module):
    """One kind of event or quantity; keeps no state of its own.

    To add one: return the names of its tallies, what one scene adds to them, and, for quantities that are averaged per
    vehicle first (Eqs. 25, 29), what to sum for each vehicle and how those sums end up in the tallies.
    """

    @abc.abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the tallies."""

    @abc.abstractmethod
    def count(self, scene: Scene) -> dict[str, Array]:
        """A scene's part of the tallies, by name, or arrays as `by_index` gives them; tallies left out get nothing."""

    def track_names(self) -> tuple[str, ...]:
        """Names of the sums over frames for each vehicle."""
        return ()

    def count_per_track(self, scene: Scene) -> dict[str, Float[Array, " object"]]:
        """A scene's part of these sums."""
        return {}

    def settle(self, tracks: dict[str, Float[Array, " track"]]) -> dict[str, Array]:
        """What the sums of all vehicles add to the tallies when the drive is over."""
        return {}


def indexed(name: str, number: int) -> tuple[str, ...]:
    """Return the names of a tally that is kept apart by section, row or bin: `name[0]`, `name[1]`, ..."""
    return tuple(f"{name}[{index}]" for index in range(number))


def by_index(name: str, values: Float[Array, " index"]) -> dict[str, Array]:
    """Return an array of increments for the names that `indexed` gives.

    It stays one array, under the name without index: each of its numbers alone would be three operations to compile.
    """
    return {name: values}


def within(values: Float[Array, " object"], border: Float[Array, " border"]) -> Bool[Array, "class object"]:
    """Between which two borders each value lies, the lower one included."""
    return (values >= border[:-1, None]) & (values < border[1:, None])


def sums_by_class(in_class: Bool[Array, "class object"], values: Float[Array, " object"]) -> Float[Array, " class"]:
    """Return the sum of values in each class.

    Objects lie along the last axis. XLA sums along it faster than it multiplies matrices so small: 4 instead of 11 us
    for two sums over 16 x 128 objects in 14 classes.
    """
    return jnp.sum(jnp.where(in_class, values, 0.0), axis=1)
