"""The part of the unit cube that one stage searches: some parameters within bounds, the others held."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxcalib.initial_values.initial_point import KNOWN_WIDTHS

NARROWEST = 1e-3  # of the unit range
LEAST_HALF_WIDTH = 0.01  # of the unit range
UNKNOWN_HALF_WIDTH = 0.35  # of the unit range, where the logs are silent
INSIDE = 1e-6  # of the unit range: values are rounded


@dataclass(frozen=True)
class SearchBox:
    """A box around a point."""

    # values of all parameters in the unit cube; those that are not searched keep them
    held: Float[np.ndarray, " parameter"]
    chosen: Int[np.ndarray, " chosen"]  # places of the parameters that are searched
    lower: Float[np.ndarray, " chosen"]  # their lower bounds in the unit cube
    upper: Float[np.ndarray, " chosen"]  # their upper bounds

    @property
    def width(self) -> Float[np.ndarray, " chosen"]:
        """Return the length of each side."""
        return self.upper - self.lower

    def unit_of(self, points: Float[np.ndarray, "candidate chosen"]) -> Float[np.ndarray, "candidate parameter"]:
        """Return points of the unit cube for points of the box, whose coordinates go from 0 to 1."""
        unit = np.tile(self.held, (len(points), 1))
        unit[:, self.chosen] = self.lower + points * (self.upper - self.lower)
        return unit

    def box_of(self, unit: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, "candidate chosen"]:
        """Return points of the box for points of the unit cube; those outside end up on its border."""
        return np.clip((unit[:, self.chosen] - self.lower) / (self.upper - self.lower), 0.0, 1.0)

    def holds(self, unit: Float[np.ndarray, "candidate parameter"]) -> Bool[np.ndarray, " candidate"]:
        """Return which points of the unit cube lie in the box; parameters that it does not search may be anywhere."""
        nearest = self.unit_of(self.box_of(unit))[:, self.chosen]
        return np.abs(nearest - unit[:, self.chosen]).max(axis=1) < INSIDE


def half_width_of(unit_error: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, " parameter"]:
    """Return how far from its initial value each parameter is searched, as a share of its range.

    Args:
        unit_error: standard error of the initial value in the unit cube; inf where the logs are silent.
    """
    half_width = np.where(np.isfinite(unit_error), KNOWN_WIDTHS * unit_error, UNKNOWN_HALF_WIDTH)
    return np.clip(half_width, LEAST_HALF_WIDTH, 0.5)


def search_box(
    center: Float[np.ndarray, " parameter"],
    chosen: Sequence[int] | Int[np.ndarray, " chosen"],
    half_width: Float[np.ndarray, " parameter"],
) -> SearchBox:
    """Return the box around a point that stays within the unit cube; at its border the box is shifted, not cut.

    Args:
        center: in the unit cube.
        chosen: parameters to search.
        half_width: of each parameter.
    """
    places = np.asarray(chosen, int)
    width = np.clip(2.0 * half_width[places], NARROWEST, 1.0)
    lower = np.clip(center[places] - width / 2.0, 0.0, 1.0 - width)
    return SearchBox(center.copy(), places, lower, lower + width)
