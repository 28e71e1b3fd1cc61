"""Figures of a sweep."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from jaxcalib.html.drawing import AFTER, BEFORE, svg, svg_grid
from jaxcalib.sweeps.influence import CandidateMeans

MOST_POINTS = 2000  # of one plot
COLUMNS = 3
LEAST_WRITTEN = 0.1


def influence_figure(means: CandidateMeans, correlation: Float[np.ndarray, "parameter measure"]) -> str:
    """Return the rank correlation of each parameter with each measure."""

    def draw(axes: Axes) -> None:
        axes.imshow(correlation, cmap="RdBu", vmin=-1.0, vmax=1.0, aspect="auto")
        for (row, column), value in np.ndenumerate(correlation):
            if np.isfinite(value) and abs(value) >= LEAST_WRITTEN:
                shade = "white" if abs(value) > 0.6 else "black"
                axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7, color=shade)
        names = [name.replace("_", " ") for name in means.measures]
        axes.set_xticks(range(len(names)), names, rotation=35, ha="right", fontsize=8)
        axes.set_yticks(range(len(means.parameters)), list(means.parameters), fontsize=8)
        axes.spines[["left", "bottom"]].set_visible(False)
        axes.tick_params(length=0)

    return svg(draw, 7.2, 0.26 * len(means.parameters) + 1.9)


def dependence_figure(
    means: CandidateMeans, correlation: Float[np.ndarray, "parameter measure"], field: Mapping[str, float]
) -> str:
    """Return each measure against the parameter that it goes with most, with the field's value where it is known."""
    names = list(means.parameters)
    strength = np.nan_to_num(np.abs(correlation))
    shown = {
        measure: names[int(strength[:, column].argmax())]
        for column, measure in enumerate(means.measures)
        if strength[:, column].max() > 0.0
    }
    step = -(-means.count // MOST_POINTS)
    num_rows = max(1, -(-len(shown) // COLUMNS))

    def draw(grid: list[list[Axes]]) -> None:
        places = [axes for row in grid for axes in row]
        for axes in places[len(shown) :]:
            axes.set_visible(False)
        for axes, (measure, parameter) in zip(places, shown.items(), strict=False):
            axes.plot(means.parameters[parameter][::step], means.measures[measure][::step], ".", color=AFTER, ms=3)
            if np.isfinite(field.get(measure, np.nan)):
                axes.axhline(field[measure], color=BEFORE, lw=1.0)
            axes.set_xlabel(parameter, fontsize=8)
            axes.set_title(measure.replace("_", " "), fontsize=8)
            axes.tick_params(labelsize=7)

    return svg_grid(draw, num_rows, COLUMNS, 7.2, 2.1 * num_rows)
