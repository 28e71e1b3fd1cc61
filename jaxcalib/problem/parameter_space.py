"""Names, bounds and scales of what is calibrated; the unit cube in which searches work, and physical values.

Ranges of driver parameters follow the ranges that calibration studies used, widened to what SUMO accepts and drivers
do: Kesting & Treiber (2008), Transp. Res. Rec. 2088 for the IDM; the bounds of PTV's and pvctools' calibrations for
Wiedemann 99; the documentation of SUMO's LC2013 for lane changing. Ranges of inputs are those of Eqs. 4-6.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.errors import CaseError, quote
from sim_adapters.interface import ParameterLayout

SIGNIFICANT_DIGITS = 6  # values are rounded to them before any run, so that files, results and runs agree


@dataclass(frozen=True)
class Range:
    """Bounds of one parameter.

    Attributes:
        lower: least value.
        upper: greatest value.
        is_logarithmic: whether factors rather than differences matter.
        unit: SI unit, empty for pure numbers.
    """

    lower: float
    upper: float
    is_logarithmic: bool = False
    unit: str = ""


_IDM = {
    "tau": Range(0.4, 3.0, True, "s"),
    "minGap": Range(0.5, 6.0, True, "m"),
    "accel": Range(0.3, 5.0, True, "m/s2"),
    "decel": Range(0.5, 8.0, True, "m/s2"),
}
_W99 = {
    "minGap": Range(0.5, 5.0, True, "m"),
    "cc1": Range(0.4, 3.0, True, "s"),
    "cc2": Range(1.0, 15.0, True, "m"),
    "cc3": Range(-20.0, -3.0, False, "s"),
    "cc4": Range(-2.0, -0.02, False, "m/s"),
    "cc5": Range(0.02, 2.0, False, "m/s"),
    "cc6": Range(0.0, 20.0, False, "1e-4/(m s)"),
    "cc7": Range(0.02, 1.2, True, "m/s2"),
    "cc8": Range(0.5, 5.0, True, "m/s2"),
    "cc9": Range(0.1, 4.0, True, "m/s2"),
    "decel": Range(1.0, 9.0, True, "m/s2"),
}
_COMMON = {
    "speedFactor": Range(0.6, 1.4),
    "speedDev": Range(0.01, 0.3),
    "lcStrategic": Range(0.1, 10.0, True),
    "lcCooperative": Range(0.0, 1.0),
    "lcCooperativeSpeed": Range(0.0, 1.0),
    "lcSpeedGain": Range(0.1, 10.0, True),
    "lcSpeedGainRight": Range(0.02, 2.0, True),
    "lcSpeedGainRemainTime": Range(2.0, 60.0, True, "s"),
    "lcKeepRight": Range(0.0, 5.0),
    "lcAssertive": Range(0.4, 4.0, True),
    "lcLookaheadLeft": Range(0.5, 5.0, True),
}
RANGES: dict[str, dict[str, Range]] = {
    "IDM": _IDM | {"delta": Range(1.0, 8.0)} | _COMMON,
    "Krauss": _IDM | {"sigma": Range(0.0, 1.0)} | _COMMON,
    "W99": _W99 | _COMMON,
}
DEFAULT_PARAMETERS: dict[str, tuple[str, ...]] = {
    "IDM": (*_IDM, "speedFactor", "speedDev", "lcStrategic", "lcSpeedGain", "lcAssertive", "lcCooperative",
            "lcCooperativeSpeed", "lcKeepRight"),
    "Krauss": (*_IDM, "sigma", "speedFactor", "speedDev", "lcStrategic", "lcSpeedGain", "lcAssertive",
               "lcCooperative", "lcCooperativeSpeed", "lcKeepRight"),
    "W99": (*_W99, "speedFactor", "speedDev", "lcAssertive", "lcSpeedGain", "lcSpeedGainRight", "lcCooperative",
            "lcCooperativeSpeed", "lcStrategic", "lcKeepRight"),
}  # fmt: skip


@dataclass(frozen=True)
class ParameterSpace:
    """All parameters: inputs first, then driver parameters, as in the layout.

    Attributes:
        layout: meaning of the numbers.
        ranges: bounds of each.
    """

    layout: ParameterLayout
    ranges: tuple[Range, ...]

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
        return DEFAULT_PARAMETERS[model]
    for name in chosen:
        if name not in RANGES[model]:
            known = ", ".join(RANGES[model])
            raise CaseError(file, "behaviour.parameters", f"expected some of {known}; got {quote(name)}.")
    if len(set(chosen)) < len(chosen):
        raise CaseError(file, "behaviour.parameters", "expected each name once.")
    return tuple(chosen)


def parameter_space(
    layout: ParameterLayout,
    model: str,
    input_vehph: np.ndarray,
    scaling_factor: float,
    bounds: Mapping[str, tuple[float, float]],
    file: str = "settings",
) -> ParameterSpace:
    """Return the space around initial inputs.

    Args:
        layout: meaning of the numbers.
        model: car-following model.
        input_vehph: initial value of each input.
        scaling_factor: delta of Eqs. 5 and 6.
        bounds: the user's bounds, by name.
        file: for messages.

    Raises:
        CaseError: bounds cross, or name something else.
    """
    least = np.maximum((1.0 - scaling_factor) * input_vehph, 0.0)
    ranges = [
        Range(low, high, unit="veh/h") for low, high in zip(least, (1.0 + scaling_factor) * input_vehph, strict=True)
    ]
    ranges += [RANGES[model][name] for name in layout.attributes]
    space = ParameterSpace(layout, tuple(ranges))
    for name, (lower, upper) in bounds.items():
        if name not in space.names:
            raise CaseError(file, f"bounds.{name}", f"expected one of {', '.join(space.names)}.")
        if not (np.isfinite([lower, upper]).all() and lower < upper):
            raise CaseError(
                file, f"bounds.{name}", f"expected a lower bound below the upper one; got {lower} and {upper}."
            )
        if space.ranges[space.index(name)].is_logarithmic and lower <= 0.0:
            raise CaseError(file, f"bounds.{name}", f"expected a lower bound above 0; got {lower}.")
        space = space.with_range(name, lower, upper)
    return space
