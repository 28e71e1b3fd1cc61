"""Figures of the diagnosis, as SVG text: the same bytes for the same result."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm

from jaxcalib.diagnosis.answer.answer import Diagnosis
from jaxcalib.diagnosis.inference.ledger import LedgerEntry
from jaxcalib.html.drawing import AFTER, BEFORE, NOISE, svg
from surrogate.effects.base import SearchedAt

MOST_NOISE = 5.0
SHOWN_EXPLANATIONS = 10


def map_figure(ledger: list[LedgerEntry]) -> str:
    """Return the gap over route and time: speeds of the field against the calibrated simulation's."""
    by_time = [entry for entry in ledger if entry.cell.locates == SearchedAt.SPELLS]
    if not by_time:
        return ""
    starts_m = sorted({entry.cell.from_m for entry in by_time if entry.cell.from_m is not None})
    ends_m = sorted({entry.cell.to_m for entry in by_time if entry.cell.to_m is not None})
    starts_s = sorted({entry.cell.from_s for entry in by_time if entry.cell.from_s is not None})
    width_s = min(e.cell.to_s - e.cell.from_s for e in by_time if e.cell.to_s and e.cell.from_s is not None)
    table = np.full((len(starts_s), len(starts_m)), np.nan)
    for entry in by_time:
        if entry.cell.from_m is not None and entry.cell.from_s is not None:
            table[starts_s.index(entry.cell.from_s), starts_m.index(entry.cell.from_m)] = entry.difference

    def draw(axes: Axes) -> None:
        edges_m = np.asarray([*starts_m, ends_m[-1]])
        edges_s = np.asarray([*starts_s, starts_s[-1] + width_s])
        mesh = axes.pcolormesh(
            edges_m, edges_s, table, cmap="RdBu", norm=TwoSlopeNorm(0.0, -MOST_NOISE, MOST_NOISE), edgecolor="white"
        )
        axes.set_xlabel("place on the route [m]")
        axes.set_ylabel("time [s]")
        bar = axes.figure.colorbar(mesh, ax=axes, label="field faster (+) or slower (-)\n[noise of the drives]")
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]

    return svg(draw, 7.2, 3.0)


def place_figure(ledger: list[LedgerEntry]) -> str:
    """Return along the route how drivers of the field accelerate beyond the calibrated model."""
    chosen = [entry for entry in ledger if entry.cell.locates == SearchedAt.STRETCHES]
    lines = {
        regime: sorted(
            (0.5 * (entry.cell.from_m + entry.cell.to_m), entry.field - entry.simulated, entry.difference)
            for entry in chosen
            if entry.cell.regime == regime and entry.cell.from_m is not None and entry.cell.to_m is not None
        )
        for regime in ("fast", "slow")
    }

    def draw(axes: Axes) -> None:
        axes.axhline(0.0, color="#222222", lw=0.8)
        for (regime, points), color in zip(lines.items(), (AFTER, BEFORE), strict=True):
            if not points:
                continue
            position_m, value, noise = np.asarray(points).T
            axes.plot(position_m, value, "-", color=color, lw=1.0, label=f"{regime} traffic")
            beyond = np.abs(noise) > 3.0
            axes.plot(position_m[beyond], value[beyond], "o", color=color, ms=6)
        axes.set_xlabel("place on the route [m]")
        axes.set_ylabel("acceleration, field less\nsimulation [m/s$^2$]")
        axes.legend(frameon=False, fontsize=8)

    return svg(draw, 7.2, 2.4)


def lanes_figure(ledger: list[LedgerEntry]) -> str:
    """Return measures that are kept by lane or regime, the largest differences."""
    chosen = [entry for entry in ledger if entry.cell.from_m is None][:16]
    names = [entry.cell.words for entry in chosen]
    height = np.arange(len(chosen))[::-1]

    def draw(axes: Axes) -> None:
        axes.axvspan(-2.0, 2.0, color=NOISE, alpha=0.6, lw=0, label="what chance does")
        values = np.clip([entry.difference for entry in chosen], -30.0, 30.0)
        axes.barh(height, values, 0.66, color=AFTER)
        axes.set_yticks(height, names, fontsize=7)
        axes.set_xlabel("field less calibrated simulation [noise of the drives; cut at 30]")
        axes.legend(frameon=False, fontsize=8, loc="lower right")

    return svg(draw, 7.2, 0.22 * len(chosen) + 0.8)


def ranking_figure(diagnosis: Diagnosis) -> str:
    """Return the probabilities of the explanations."""
    shown = diagnosis.ranking[:SHOWN_EXPLANATIONS]
    height = np.arange(len(shown))[::-1]

    def draw(axes: Axes) -> None:
        colors = [AFTER if entry.effect in diagnosis.effects else "#9dbad5" for entry in shown]
        axes.barh(height, [entry.probability for entry in shown], 0.7, color=colors)
        axes.set_yticks(height, [entry.effect.replace("_", " ") for entry in shown])
        axes.set_xlim(0.0, 1.0)
        axes.set_xlabel("probability")

    return svg(draw, 7.2, 0.24 * len(shown) + 0.7)


def waterfall_figure(diagnosis: Diagnosis) -> str:
    """The gap step by step, as it shrinks."""
    far = diagnosis.how_far
    if far.get("gap_recalibrated") is None:
        return ""
    steps = [
        ("scenario as it is", far["gap_default"], BEFORE),
        ("recalibrated", far["gap_recalibrated"], "#e08a1e"),
        ("with the effect" if diagnosis.effects else "no effect added", far["gap_with_effect"], AFTER),
    ]
    steps = [step for step in steps if step[1] is not None]  # the scenario as it is may keep the subject vehicle out
    height = np.arange(len(steps))[::-1]

    def draw(axes: Axes) -> None:
        values = [value for _, value, _ in steps]
        axes.axvspan(0.0, far["noise_floor"], color=NOISE, alpha=0.8, lw=0, label="chance alone")
        axes.barh(height, values, 0.6, color=[color for _, _, color in steps])
        for y, value in zip(height, values, strict=True):
            axes.text(value, y, f" {value:.2f}", va="center", fontsize=8)
        if far.get("fraction_closed_ci90"):
            low, high = far["fraction_closed_ci90"]
            above = far["gap_recalibrated"] - far["noise_floor"]
            ends = [far["gap_recalibrated"] - above * share for share in (high, low)]
            axes.plot(ends, [height[-1], height[-1]], color="#222222", lw=1.2)
        axes.set_yticks(height, [name for name, _, _ in steps])
        axes.set_xlabel("gap on held-out drives: mean squared difference [noise of the drives]")
        axes.margins(x=0.12)
        axes.legend(frameon=False, fontsize=8)

    return svg(draw, 7.2, 1.7)
