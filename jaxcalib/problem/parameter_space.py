"""Names, bounds and scales of what is calibrated; the unit cube in which searches work, and physical values.

Bounds of driver parameters are those for traffic in the rows of the models (`surrogate.vehicle.model_entry.Parameter`),
in SUMO's names (`sim_adapters.scenario.sumo_names`). Ranges of inputs are those of Eqs. 4-6.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.errors import CaseError, quote
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.sumo_names import SUMO_MODELS, attributes_of, following_attributes, parameter_of
from surrogate.vehicle.model_entry import Parameter

SIGNIFICANT_DIGITS = 6  # values are rounded to them before any run, so that files, results and runs agree


@dataclass(frozen=True)
class Range:
    """Bounds of one parameter."""

    lower: float  # least value
    upper: float  # greatest value
    is_logarithmic: bool = False  # whether factors rather than differences matter
    unit: str = ""  # SI unit, empty for pure numbers


_ALL_MODELS = ("speedFactor", "speedDev", "lcStrategic", "lcSpeedGain", "lcAssertive", "lcCooperative",
               "lcCooperativeSpeed", "lcKeepRight")  # fmt: skip
# What is calibrated where the case names nothing: a choice, and an order on which random designs depend.
DEFAULT_PARAMETERS: dict[str, tuple[str, ...]] = {
    "IDM": ("tau", "minGap", "accel", "decel", *_ALL_MODELS),
    "Krauss": ("tau", "minGap", "accel", "decel", "sigma", *_ALL_MODELS),
    "W99": ("minGap", "cc1", "cc2", "cc3", "cc4", "cc5", "cc6", "cc7", "cc8", "cc9", "decel", "speedFactor", "speedDev",
            "lcAssertive", "lcSpeedGain", "lcSpeedGainRight", "lcCooperative", "lcCooperativeSpeed", "lcStrategic",
            "lcKeepRight"),
}  # fmt: skip


def ranges_of(model: str) -> dict[str, Range]:
    """Return the bounds of all driver parameters of a car-following model, in SUMO's names and units."""
    ranges = {}
    for name, attribute in attributes_of(model).items():
        row = parameter_of(model, attribute)
        if row is not None:
            lower, upper = sorted(bound / attribute.factor for bound in row.traffic_range)
            ranges[name] = Range(lower, upper, row.is_logarithmic, attribute.own_unit or row.unit)
    return ranges


def default_parameters(model: str) -> tuple[str, ...]:
    """Return the driver parameters that are calibrated where the case names none; of a new model all that follow."""
    return DEFAULT_PARAMETERS.get(model, (*following_attributes(model), *_ALL_MODELS))


def slope_share(attribute: str) -> float:
    """Return the share of an attribute's value by which slopes are taken."""
    for model in SUMO_MODELS:
        known = attributes_of(model).get(attribute)
        row = None if known is None else parameter_of(model, known)
        if row is not None:
            return row.step
    return Parameter.step


@dataclass(frozen=True)
class ParameterSpace:
    """All parameters: inputs first, then driver parameters, as in the layout."""

    layout: ParameterLayout  # meaning of the numbers
    ranges: tuple[Range, ...]  # bounds of each

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.layout.names

    @property
    def lower(self) -> np.ndarray:
        """Least values."""
        return np.asarray([one.lower for one in self.ranges])

    @property
    def upper(self) -> np.ndarray:
        """Greatest values."""
        return np.asarray([one.upper for one in self.ranges])

    def index(self, name: str) -> int:
        """Return the place of a parameter."""
        return self.names.index(name)

    def of_first_group(self) -> "ParameterSpace":
        """Return the space of inputs and of the driver parameters of the first group of vTypes alone."""
        layout = replace(self.layout, groups=self.layout.vtype_groups[:1])
        return ParameterSpace(layout, self.ranges[: len(layout.names)])

    def unit_of(self, values: np.ndarray) -> np.ndarray:
        """Return the point of the unit cube for values; values outside the bounds end up on them."""
        low, high, values = self._stretch(self.lower), self._stretch(self.upper), self._stretch(np.asarray(values))
        return np.clip((values - low) / (high - low), 0.0, 1.0)

    def values_of(self, unit: np.ndarray) -> np.ndarray:
        """Return rounded values for points of the unit cube."""
        low, high = self._stretch(self.lower), self._stretch(self.upper)
        stretched = low + np.clip(unit, 0.0, 1.0) * (high - low)
        is_log = np.asarray([one.is_logarithmic for one in self.ranges])
        values = np.where(is_log, np.exp(np.where(is_log, stretched, 0.0)), stretched)
        return round_values(np.clip(values, self.lower, self.upper))

    def slope_of(self, values: np.ndarray) -> np.ndarray:
        """Return the change of each value per change of its unit coordinate."""
        low, high = self._stretch(self.lower), self._stretch(self.upper)
        is_log = np.asarray([one.is_logarithmic for one in self.ranges])
        return (high - low) * np.where(is_log, np.asarray(values), 1.0)

    def with_range(self, name: str, lower: float, upper: float) -> "ParameterSpace":
        """Return the space with other bounds for one parameter."""
        ranges = list(self.ranges)
        ranges[self.index(name)] = replace(self.ranges[self.index(name)], lower=lower, upper=upper)
        return replace(self, ranges=tuple(ranges))

    def _stretch(self, values: np.ndarray) -> np.ndarray:
        is_log = np.asarray([one.is_logarithmic for one in self.ranges])
        return np.where(is_log, np.log(np.where(is_log, np.maximum(values, 1e-12), 1.0)), values)


def round_values(values: np.ndarray) -> np.ndarray:
    """Return values with as many digits as results are written with."""
    values = np.asarray(values, float)
    magnitude = np.where(
        values == 0, 1.0, 10.0 ** (SIGNIFICANT_DIGITS - 1 - np.floor(np.log10(np.abs(values) + 1e-300)))
    )
    return np.where(values == 0, 0.0, np.round(values * magnitude) / magnitude)


def behaviour_parameters(file: str, model: str, chosen: Sequence[str] | None) -> tuple[str, ...]:
    """Return the driver parameters to calibrate.

    Args:
        file: for messages.
        model: car-following model.
        chosen: names from the case, or None for the library's list.

    Raises:
        CaseError: a name is not known, or there for the second time.
    """
    if chosen is None:
        return default_parameters(model)
    ranges = ranges_of(model)
    for name in chosen:
        if name not in ranges:
            known = ", ".join(ranges)
            raise CaseError(file, "behaviour.parameters", f"expected some of {known}; got {quote(name)}.")
    if len(set(chosen)) < len(chosen):
        raise CaseError(file, "behaviour.parameters", "expected each name once.")
    return tuple(chosen)


def parameter_space(
    layout: ParameterLayout,
    model: str,
    input_vehph: np.ndarray,
    scaling_factor: float | Float[np.ndarray, " input"],
    bounds: Mapping[str, tuple[float, float]],
    file: str = "settings",
    behaviour: Sequence[float] | None = None,
) -> ParameterSpace:
    """Return the space around initial inputs.

    Args:
        layout: meaning of the numbers.
        model: car-following model.
        input_vehph: initial value of each input.
        scaling_factor: delta of Eqs. 5 and 6, for all inputs or for each.
        bounds: the user's bounds, by name; those of a plain attribute hold for each group without bounds of its own.
        file: for messages.
        behaviour: the scenario's driver parameters, which lie within the bounds even where traffic has others.

    Raises:
        CaseError: bounds cross, or name something else.
    """
    least = np.maximum((1.0 - scaling_factor) * input_vehph, 0.0)
    ranges = [
        Range(low, high, unit="veh/h") for low, high in zip(least, (1.0 + scaling_factor) * input_vehph, strict=True)
    ]
    of_model = ranges_of(model)
    of_drivers = [of_model[attribute] for _, attribute in layout.driver_parameters]
    ranges += of_drivers if behaviour is None else map(_holding, of_drivers, behaviour)
    space = ParameterSpace(layout, tuple(ranges))
    for name, (lower, upper) in bounds.items():
        chosen = [name] if name in space.names else [one for one in layout.names_of(name) if one not in bounds]
        if not chosen and not layout.names_of(name):
            raise CaseError(file, f"bounds.{name}", f"expected one of {', '.join(space.names)}.")
        if not (np.isfinite([lower, upper]).all() and lower < upper):
            raise CaseError(
                file, f"bounds.{name}", f"expected a lower bound below the upper one; got {lower} and {upper}."
            )
        for one in chosen:
            if space.ranges[space.index(one)].is_logarithmic and lower <= 0.0:
                raise CaseError(file, f"bounds.{name}", f"expected a lower bound above 0; got {lower}.")
            space = space.with_range(one, lower, upper)
    return space


def _holding(one: Range, value: float) -> Range:
    """Return a range that holds a value, too; a logarithmic one as far as it is above 0."""
    if one.is_logarithmic and value <= 0.0:
        return one
    return replace(one, lower=min(one.lower, float(value)), upper=max(one.upper, float(value)))
