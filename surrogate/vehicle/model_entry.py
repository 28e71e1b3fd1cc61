"""What registries of models share: entries with parameters, their ranges and usual values, found by name."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax.numpy as jnp

Model = TypeVar("Model", bound=eqx.Module)


class UnknownModelError(ValueError):
    """There is no such model, or it has no such parameter; the message lists the known ones."""


class ParameterRangeError(ValueError):
    """A parameter is not finite or outside its range."""


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A parameter of a model.

    Attributes:
        name: field of the model, with its unit.
        usual: value to begin with.
        lower: least value.
        upper: greatest value.
    """

    name: str
    usual: float
    lower: float
    upper: float


@dataclasses.dataclass(frozen=True, eq=False)  # compared and hashed by identity, so that programs may depend on it
class ModelEntry(Generic[Model]):
    """A model of the registry.

    Attributes:
        name: by which users call it.
        description: one line.
        model: its class.
        parameters: what may be fitted.
        fixed: the other fields.
    """

    name: str
    description: str
    model: type[Model]
    parameters: tuple[Parameter, ...]
    fixed: Mapping[str, float]

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
        numbers = {**self.fixed, **{one.name: one.usual for one in self.parameters}, **values}
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
