"""Error against cost, and mean ranks."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from jaxcalib.html.drawing import STYLE

COLUMNS = 3
MARKERS = "osD^vP*X<>hpd"


def draw_courses(summary: pd.DataFrame, budget: str, file: Path) -> None:
    """Write one panel for each problem: median error at the checkpoints, with the interval at the last, as SVG."""
    chosen: Any = summary[(summary["budget"] == budget) & np.isfinite(summary["median"])]
    problems = list(dict.fromkeys(chosen["problem"]))
    optimisers = list(dict.fromkeys(summary["optimiser"]))
    colors = mpl.colormaps["tab20"](np.linspace(0.0, 1.0, 20))

    def draw(axes: Axes, problem: str) -> None:
        for number, optimiser in enumerate(optimisers):
            group = chosen[(chosen["problem"] == problem) & (chosen["optimiser"] == optimiser)]
            if group.empty:
                continue
            cost = group["num_evaluated"] if budget == "simulations" else group["optimiser_s"] + group["evaluation_s"]
            color, marker = colors[number % 20], MARKERS[number % len(MARKERS)]
            axes.plot(cost, group["median"], "-", marker=marker, ms=3.5, lw=1.0, color=color, label=optimiser)
            last = group.iloc[-1]
            axes.vlines(cost.iloc[-1], last["low"], last["high"], color=color, lw=2.0, alpha=0.35)
        axes.set_title(problem)
        axes.set_yscale("log")
        axes.set_xscale("log")
        if budget == "simulations":
            ticks = sorted(set(chosen["num_evaluated"].astype(int)))
            axes.set_xticks(ticks, [str(tick) for tick in ticks])
            axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel("candidates evaluated" if budget == "simulations" else "optimiser and simulations [s]")
        axes.set_ylabel("error (median; bar: 95 % interval)")

    _write(problems, draw, file)


def draw_ranks(ranks: pd.DataFrame, file: Path) -> None:
    """Write mean ranks of one budget at its end, one panel for each problem and for all, as SVG."""

    def draw(axes: Axes, problem: str) -> None:
        group: Any = ranks[ranks["problem"] == problem]
        height = np.arange(len(group))[::-1]
        is_worse = (group["p_value"] < 0.05).to_numpy()
        axes.barh(height, group["mean_rank"], 0.7, color=np.where(is_worse, "#9dbad5", "#1f6fb4").tolist())
        axes.set_yticks(height, group["optimiser"])
        axes.set_title(problem)
        axes.set_xlabel("mean rank; pale: worse than the first (p < 0.05)")

    _write(list(dict.fromkeys(ranks["problem"])), draw, file)


def _write(panels: list[str], draw: Callable[[Axes, str], None], file: Path) -> None:
    if not panels:  # every search failed
        return
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2 * columns, 3.2 * rows), layout="constrained")
        for number, panel in enumerate(panels):
            draw(figure.add_subplot(rows, columns, number + 1), panel)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
