"""Figures 7 to 13 of the paper for a study, from its trials alone."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes

from experiments.paper.comparison import chance_of, critical_sets, mean_errors, noise_floor_of, paired
from experiments.paper.methods import IMPROVED, NO_CALIBRATION, PRINTED, STATE_OF_THE_ART, label_of
from experiments.paper.similarity import similarity_matrix
from experiments.paper.trial import Trial
from jaxcalib.calibration.objective.accuracy import MOES, TRAFFIC_LEVEL, VEHICLE_LEVEL, VEHICLE_LEVEL_SUM
from jaxcalib.html.drawing import AFTER, BEFORE, NOISE, svg, svg_grid

COLORS = {NO_CALIBRATION: "#9a9a9a", STATE_OF_THE_ART: BEFORE, PRINTED: "#8fb8de", IMPROVED: AFTER}
PANEL_LETTERS = "abcdefghi"


def all_figures(trials: Sequence[Trial]) -> dict[str, str]:
    """Return all figures that the trials suffice for, SVG text by name."""
    drawn = {
        "figure_07_traffic_flow": _aspects(trials, TRAFFIC_LEVEL),
        "figure_08_vehicle_level": _vehicle_level(trials),
        "figure_09_longitudinal_and_lateral": _aspects(trials, VEHICLE_LEVEL),
        "figure_10_improvements": _improvements(trials),
        "figure_11_error_per_aspect": _per_aspect(trials),
        "figure_12_cost": _cost(trials),
        "figure_13_similarity": _similarity(trials),
    }
    return {name: text for name, text in drawn.items() if text is not None}


def methods_of(trials: Sequence[Trial]) -> list[str]:
    """Return the methods of a study in the order in which they came."""
    return list(dict.fromkeys(trial.method for trial in trials))


def _dots(
    axes: Axes, trials: Sequence[Trial], methods: Sequence[str], value_of: Callable[[Trial], float | None]
) -> None:
    """Draw every trial as a dot and the mean of each method as a bar."""
    for number, method in enumerate(methods):
        values = [value_of(trial) for trial in trials if trial.method == method]
        known = np.asarray([value for value in values if value is not None], float)
        if not len(known):
            continue
        color = COLORS.get(method, "#4f9d69")
        axes.bar(number, known.mean(), 0.7, color=color, alpha=0.75)
        spread = np.linspace(-0.2, 0.2, len(known)) if len(known) > 1 else np.zeros(1)
        axes.plot(number + spread, known, "o", color="#222222", ms=2.5)
    axes.set_xticks(range(len(methods)), [label_of(method) for method in methods], rotation=30, ha="right", fontsize=7)
    axes.set_ylim(bottom=0.0)


def _aspects(trials: Sequence[Trial], names: Sequence[str]) -> str:
    methods, floor = methods_of(trials), noise_floor_of(trials)

    def draw(grid: list[list[Axes]]) -> None:
        for letter, axes, name in zip(PANEL_LETTERS, grid[0], names, strict=False):
            _dots(axes, trials, methods, lambda trial, name=name: _percent(trial.errors.get(name)))
            axes.axhspan(0.0, 100.0 * (floor[name] or 0.0), color=NOISE, alpha=0.6, lw=0, zorder=0)
            axes.set_title(f"({letter}) {name.replace('_', ' ')}", fontsize=8)
        grid[0][0].set_ylabel("error [%]; grey: noise floor")

    return svg_grid(draw, 1, len(names), 2.0 * len(names) + 0.6, 3.0)


def _vehicle_level(trials: Sequence[Trial]) -> str:
    methods = methods_of(trials)

    def draw(axes: Axes) -> None:
        _dots(axes, trials, methods, lambda trial: 100.0 * trial.vehicle_level)
        axes.axhspan(0.0, 100.0 * (noise_floor_of(trials)[VEHICLE_LEVEL_SUM] or 0.0), color=NOISE, alpha=0.6, lw=0,
                     zorder=0)  # fmt: skip
        axes.set_ylabel("vehicle-level error (Eq. 23) [%]\ngrey: noise floor")

    return svg(draw, 1.1 * len(methods) + 1.0, 3.2)


def _improvements(trials: Sequence[Trial]) -> str | None:
    ours = [method for method in (PRINTED, IMPROVED) if any(trial.method == method for trial in trials)]
    others = [
        method for method in (NO_CALIBRATION, STATE_OF_THE_ART) if any(trial.method == method for trial in trials)
    ]
    if not ours or not others:
        return None
    names = list(MOES)
    height = np.arange(len(names))[::-1]

    def draw(grid: list[list[Axes]]) -> None:
        for letter, axes, other in zip(PANEL_LETTERS, grid[0], others, strict=False):
            for number, method in enumerate(ours):
                pairs = paired(trials, method, other)
                before, after = (mean_errors([pair[side] for pair in pairs]) for side in (1, 0))
                change = [_difference(after[name], before[name]) for name in names]
                shift = 0.19 * (1 - 2 * number) if len(ours) > 1 else 0.0
                axes.barh(height + shift, change, 0.36, color=COLORS[method], label=label_of(method))
            axes.axvline(0.0, color="#222222", lw=0.8)
            axes.set_yticks(height, [name.replace("_", " ") for name in names], fontsize=7)
            axes.set_title(f"({letter}) against {label_of(other)}", fontsize=8)
            axes.set_xlabel("error saved [percentage points]", fontsize=8)
        grid[0][0].legend(frameon=False, fontsize=7)

    return svg_grid(draw, 1, len(others), 4.2 * len(others), 3.6)


def _per_aspect(trials: Sequence[Trial]) -> str | None:
    ours = [method for method in (PRINTED, IMPROVED) if any(trial.method == method for trial in trials)]
    if not ours:
        return None
    floor, names = noise_floor_of(trials), list(MOES)
    height = np.arange(len(names))[::-1]

    def draw(axes: Axes) -> None:
        axes.barh(height, [100.0 * (floor[name] or 0.0) for name in names], 0.86, color=NOISE, label="noise floor")
        axes.axvspan(9.0, 27.4, color="#f2d8a7", alpha=0.35, lw=0, zorder=0, label="the paper's 9.0 to 27.4 %")
        for method in ours:
            means = mean_errors([trial for trial in trials if trial.method == method])
            values = [np.nan if means[name] is None else 100.0 * float(means[name] or 0.0) for name in names]
            axes.plot(values, height, "o", color=COLORS[method], ms=6, label=label_of(method))
        axes.set_yticks(height, [name.replace("_", " ") for name in names])
        axes.set_xlabel("mean error [%]")
        axes.set_xlim(left=0.0)
        axes.legend(frameon=False, fontsize=7)

    return svg(draw, 7.2, 4.0)


def _cost(trials: Sequence[Trial]) -> str | None:
    methods = [method for method in methods_of(trials) if method != NO_CALIBRATION]
    if not methods:
        return None

    def draw(grid: list[list[Axes]]) -> None:
        _dots(grid[0][0], trials, methods, lambda trial: trial.calibration_s / 60.0)
        grid[0][0].set_ylabel("calibration time [min]")
        _dots(grid[0][1], trials, methods, lambda trial: float(trial.surrogate_runs))
        grid[0][1].set_ylabel("runs in the surrogate")
        _dots(grid[0][2], trials, methods, lambda trial: float(trial.sumo_runs))
        grid[0][2].set_ylabel("runs in SUMO")

    return svg_grid(draw, 1, 3, 3.0 * len(methods), 3.0)


def _similarity(trials: Sequence[Trial]) -> str | None:
    ours = [
        method
        for method in methods_of(trials)
        if len(critical_sets([trial for trial in trials if trial.method == method])) > 1
    ]
    if not ours:
        return None
    chance = chance_of(trials)

    def draw(grid: list[list[Axes]]) -> None:
        for axes, method in zip(grid[0], ours, strict=True):
            sets = critical_sets([trial for trial in trials if trial.method == method])
            matrix = similarity_matrix(list(sets.values()))
            axes.imshow(matrix, vmin=0.0, vmax=1.0, cmap="Blues")
            for (row, column), value in np.ndenumerate(matrix):
                axes.text(column, row, f"{value:.1f}", ha="center", va="center", fontsize=7,
                          color="white" if value > 0.6 else "black")  # fmt: skip
            names = [str(pattern) for pattern in sets]
            axes.set_xticks(range(len(names)), names)
            axes.set_yticks(range(len(names)), names)
            axes.set_title(f"{label_of(method)}; chance: {chance:.2f}", fontsize=8)
            axes.set_xlabel("traffic pattern")
        grid[0][0].set_ylabel("traffic pattern")

    return svg_grid(draw, 1, len(ours), 3.0 * len(ours), 3.0)


def _percent(value: float | None) -> float | None:
    return None if value is None else 100.0 * value


def _difference(after: float | None, before: float | None) -> float:
    return np.nan if after is None or before is None else 100.0 * (before - after)
