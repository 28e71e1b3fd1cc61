"""Figures as SVG text: the same bytes for the same data."""

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BEFORE, AFTER, FIELD, NOISE = "#c0504d", "#1f6fb4", "#222222", "#d9d9d9"
STYLE: dict[Any, Any] = {"svg.hashsalt": "jaxcalib", "svg.fonttype": "none", "font.size": 9.0, "axes.spines.top": False,
         "axes.spines.right": False, "axes.titlesize": 10.0, "font.family": "sans-serif"}  # fmt: skip


def svg(draw: Callable[[Axes], None], width_in: float, height_in: float) -> str:
    """Return a figure of one plot as SVG text.

    Args:
        draw: draws into it.
        width_in: width in inches.
        height_in: height in inches.
    """
    return svg_grid(lambda axes: draw(axes[0][0]), 1, 1, width_in, height_in)


def svg_grid(
    draw: Callable[[list[list[Axes]]], None], num_rows: int, num_columns: int, width_in: float, height_in: float
) -> str:
    """Return a figure of several plots as SVG text.

    Args:
        draw: draws into them, [row][column].
        num_rows: rows of plots.
        num_columns: columns of plots.
        width_in: width in inches.
        height_in: height in inches.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(figure.subplots(num_rows, num_columns, squeeze=False).tolist())
        return svg_text(figure)


def svg_text(figure: Figure) -> str:
    """A figure as an <svg> element, the same for the same figure."""
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = re.sub(r"\s*<metadata>.*?</metadata>", "", stream.getvalue(), flags=re.DOTALL)
    return text[text.index("<svg") :]
