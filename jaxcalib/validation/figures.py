"""Figures of a validation."""

import numpy as np
from matplotlib.axes import Axes

from jaxcalib.html.drawing import AFTER, BEFORE, FIELD, NOISE, svg
from jaxcalib.validation.result import ValidationResult

CLIP = 4.0  # half widths of the interval


def measures_figure(result: ValidationResult) -> str:
    """Return the field's value of each measure within the interval that rounds of simulated drives predict."""
    names, places = [], []
    for name, entry in result.measures.items():
        if entry["p_value"] is None or entry["interval_90"] is None:
            continue
        low, high = entry["interval_90"]
        if high > low:
            names.append(name)
            places.append((entry["field"] - entry["simulated"]) / (0.5 * (high - low)))
    height = np.arange(len(names))[::-1]
    beyond = np.asarray([bool(result.measures[name]["is_beyond_chance"]) for name in names], bool)
    clipped = np.clip(np.asarray(places, float), -CLIP, CLIP)

    def draw(axes: Axes) -> None:
        axes.axvspan(-1.0, 1.0, color=NOISE, alpha=0.6, lw=0, label="90 % of rounds of simulated drives")
        axes.axvline(0.0, color=FIELD, lw=0.6)
        axes.plot(clipped[~beyond], height[~beyond], "o", color=AFTER, ms=3.5, label="field")
        axes.plot(clipped[beyond], height[beyond], "o", color=BEFORE, ms=4.5, label="field, beyond chance (Holm)")
        axes.set_yticks(height, names, fontsize=6)
        axes.set_xlim(-CLIP - 0.2, CLIP + 0.2)
        axes.set_ylim(-1, len(names))
        axes.set_xlabel("field less simulated mean, in half widths of the interval")
        axes.legend(frameon=False, loc="upper right", fontsize=7)

    return svg(draw, 7.2, 0.125 * len(names) + 1.2)


def distances_figure(result: ValidationResult) -> str:
    """Return distances of distributions and errors of trajectories, as multiples of what chance allows."""
    distances = {name: entry["wasserstein"] for name, entry in result.distributions.items()} | result.trajectories
    known = {name: entry for name, entry in distances.items() if entry["value"] and entry["limit"]}
    rows = {name: entry["value"] / entry["limit"] for name, entry in known.items()}
    height = np.arange(len(rows))[::-1]

    def draw(axes: Axes) -> None:
        colors = [BEFORE if value > 1.0 else AFTER for value in rows.values()]
        axes.barh(height, list(rows.values()), 0.7, color=colors)
        axes.axvline(1.0, color=FIELD, lw=1.0)
        axes.set_yticks(height, [name.replace("_", " ") for name in rows])
        axes.set_xlabel("distance from the field, 1 = what a round of simulated drives exceeds in 5 % of the cases")

    return svg(draw, 7.2, 0.26 * len(rows) + 0.9)


def margins_figure(result: ValidationResult) -> str:
    """Return the difference of each quantity from the field's with its 90 % interval, in multiples of its margin."""
    known = {name: entry for name, entry in result.equivalence.items() if entry["interval_90"]}
    height = np.arange(len(known))[::-1]
    colors = {"equivalent": AFTER, "different": BEFORE}

    def draw(axes: Axes) -> None:
        axes.axvspan(-1.0, 1.0, color=NOISE, alpha=0.6, lw=0, label="within the margin")
        axes.axvline(0.0, color=FIELD, lw=0.6)
        for place, entry in zip(height, known.values(), strict=True):
            low, middle, high = (
                float(np.clip(share / entry["margin"], -CLIP, CLIP))
                for share in (entry["interval_90"][0], entry["difference"], entry["interval_90"][1])
            )
            color = colors.get(entry["verdict"], FIELD)
            axes.plot([low, high], [place, place], "-", color=color, lw=1.6)
            axes.plot([middle], [place], "o", color=color, ms=4.5)
        axes.set_yticks(height, [name.replace("_", " ") for name in known], fontsize=7)
        axes.set_xlim(-CLIP - 0.2, CLIP + 0.2)
        axes.set_ylim(-1, len(known))
        axes.set_xlabel("simulated less field, in margins; line: 90 % interval")
        axes.legend(frameon=False, loc="upper right", fontsize=7)

    return svg(draw, 7.2, 0.26 * len(known) + 1.0)
