"""What registries of models share: entries with parameters, their ranges and usual values, found by name."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax.numpy as jnp

Model = TypeVar("Model", bound=eqx.Module, covariant=True)


class UnknownModelError(ValueError):
    """There is no such model, or it has no such parameter; the message lists the known ones."""


class ParameterRangeError(ValueError):
    """A parameter is not finite or outside its range."""


# suffixes of names, and what they say; the longest that fits counts
UNITS = {
    "_mps2": "m/s2", "_mps": "m/s", "_m": "m", "_s": "s", "_1ps2": "1/s2", "_1ps": "1/s",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A parameter of a model: one row of the only table that says what it may be.

    Two ranges, for two uses. `lower` to `upper` is for one driver: a single leader-follower pair, or a subject vehicle,
    may lie far out. `traffic` is for what all drivers of a class share while whole traffic is simulated: narrower where
    the mean of many cannot lie so far out, wider where SUMO's defaults, from which such a search begins, lie beyond
    what single drivers show (its decelerations and accelerations are bounds more than habits).
    """

    name: str  # field of the model, with its unit
    usual: float  # value to begin with
    lower: float  # least value for one driver
    upper: float  # greatest value for one driver
    # least and greatest value for a class of drivers in traffic; None for the same
    traffic: tuple[float, float] | None = None
    is_logarithmic: bool = False  # whether searches in traffic go by factors rather than differences
    # share of the value by which it is moved to see what it does; about what a calibration leaves open
    step: float = 0.1
    is_fitted: bool = True  # whether leader-follower pairs show it; else it keeps its usual value for them
    own_unit: str = ""  # unit where the name's suffix does not say it

    @property
    def unit(self) -> str:
        """SI unit, empty for a pure number."""
        return self.own_unit or next((unit for suffix, unit in UNITS.items() if self.name.endswith(suffix)), "")

    @property
    def traffic_range(self) -> tuple[float, float]:
        """Least and greatest value for a class of drivers in traffic."""
        return self.traffic or (self.lower, self.upper)


@dataclasses.dataclass(frozen=True, eq=False)  # compared and hashed by identity, so that programs may depend on it
class ModelEntry(Generic[Model]):
    """A model of the registry."""

    name: str  # by which users call it
    description: str  # one line
    model: type[Model]  # its class
    rows: tuple[Parameter, ...]  # its parameters
    fixed: Mapping[str, float] = dataclasses.field(default_factory=dict)  # the other fields
    source: str = ""  # where the ranges come from

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What may be fitted to leader-follower pairs, and set for one vehicle."""
        return tuple(row for row in self.rows if row.is_fitted)

    def row(self, name: str) -> Parameter | None:
        """Return the row of a field; None where there is none."""
        return next((row for row in self.rows if row.name == name), None)

    def build(self, values: Mapping[str, Any] | None = None) -> Model:
        """Return the model, usual values where none is given; works on traced values.

        Raises:
            UnknownModelError: a parameter does not exist.
            ParameterRangeError: a number is not finite or outside its range.
        """
        values = values or {}
        known = {one.name: one for one in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise UnknownModelError(f"{self.name} has no parameter '{name}'; it has {', '.join(known)}.")
            if isinstance(value, int | float):
                check_range(self.name, known[name], float(value))
        return self.assemble(values)

    def assemble(self, fields: Mapping[str, Any]) -> Model:
        """Return the model with these fields, whatever their values, and the others as they usually are."""
        numbers = {**self.fixed, **{one.name: one.usual for one in self.rows}, **fields}
        return self.model(**{name: jnp.asarray(value) for name, value in numbers.items()})


def find(entries: Sequence[ModelEntry[Model]], name: str, kind: str) -> ModelEntry[Model]:
    """Return the entry with this name.

    Args:
        entries: the registry.
        name: of the model, in upper or lower case.
        kind: what the registry holds, for the message.

    Raises:
        UnknownModelError: there is no such model.
    """
    for entry in entries:
        if entry.name == name.lower():
            return entry
    known = ", ".join(entry.name for entry in entries)
    raise UnknownModelError(f"there is no {kind} model '{name}'; known are {known}.")


def check_range(model: str, parameter: Parameter, value: float) -> None:
    """Check a value.

    Raises:
        ParameterRangeError: it is not finite or outside its range.
    """
    if not math.isfinite(value) or not parameter.lower <= value <= parameter.upper:
        raise ParameterRangeError(
            f"{model}: {parameter.name} is {value:g}; expected {parameter.lower:g} to {parameter.upper:g}."
        )
