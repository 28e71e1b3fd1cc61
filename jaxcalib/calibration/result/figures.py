"""Figures of a calibration's report."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.result.result import CalibrationResult
from jaxcalib.html.drawing import AFTER, BEFORE, FIELD, NOISE, svg
from jaxcalib.statistics.normal import HALF_WIDTH_90


def errors_figure(result: CalibrationResult, role: str) -> str:
    """Return the errors of Eqs. 24-36 before and after, with intervals, over the noise floor."""
    names = [name for name, error in result.moes["calibrated"][role].items() if error is not None]
    place = np.arange(len(names))[::-1]

    def draw(axes: Axes) -> None:
        floor = [100.0 * (result.noise_floor_high[role].get(name) or 0.0) for name in names]
        axes.barh(place, floor, 0.86, color=NOISE, label="noise floor (95 % of field-like sets)")
        for kind, color, shift in (("no_calibration", BEFORE, 0.18), ("calibrated", AFTER, -0.18)):
            values = np.asarray([100.0 * (result.moes[kind][role][name] or 0.0) for name in names])
            bounds = [result.intervals[kind][role].get(name) or (np.nan, np.nan) for name in names]
            low, high = 100.0 * np.asarray(bounds, float).T
            axes.hlines(place + shift, low, high, color=color, lw=1.2, alpha=0.6)
            axes.plot(values, place + shift, "o", color=color, ms=5, label=kind.replace("_", " "))
        axes.set_yticks(place, [name.replace("_", " ") for name in names])
        axes.set_xlabel("error [%], pooled over seeds; lines: 90 % interval")
        axes.set_xlim(left=0.0)
        axes.legend(frameon=False, loc="lower right", fontsize=8)

    return svg(draw, 7.2, 0.42 * len(names) + 1.0)


def measures_figure(record: CalibrationRecord) -> str:
    """Return field against both simulators, per measure, in standard deviations of the field's drives."""
    objective = record.found.objective
    confirmed = record.confirmation.confirmed[record.confirmation.winner]
    deviation = np.sqrt(np.diag(objective.covariance) / objective.num_drives)
    place = np.arange(len(deviation))[::-1]

    def draw(axes: Axes) -> None:
        axes.axvspan(-2.0, 2.0, color=NOISE, alpha=0.6, lw=0, label="95 % of seeds, at the true parameters")
        axes.axvline(0.0, color=FIELD, lw=0.8, label="field")
        for tally, runs, color, marker, name in (
            (confirmed.surrogate, confirmed.surrogate_runs, "#e08a1e", "s", "surrogate"),
            (confirmed.sumo, confirmed.sumo_runs, AFTER, "o", "SUMO"),
        ):
            difference = (objective.moments.values(tally) - objective.field) / deviation
            spread = HALF_WIDTH_90 * np.sqrt(objective.num_drives / runs)
            axes.hlines(place, difference - spread, difference + spread, color=color, lw=0.8, alpha=0.5)
            axes.plot(difference, place, marker, color=color, ms=3.5, label=name)
        axes.set_yticks(place, objective.moments.names, fontsize=7)
        axes.set_xlim(-8, 8)
        axes.set_ylim(-1, len(deviation))
        axes.set_xlabel("simulated less field, in standard deviations over drives and seeds")
        axes.legend(frameon=False, loc="upper right", fontsize=7)

    return svg(draw, 7.2, 0.155 * len(deviation) + 1.0)


def screening_figure(screening: dict[str, object]) -> str:
    """Return the range of each parameter beside the range that noise alone would show."""
    rows: Sequence[dict[str, object]] = screening["parameters"]  # pyright: ignore[reportAssignmentType]
    place = np.arange(len(rows))[::-1]

    def draw(axes: Axes) -> None:
        for y, row in zip(place, rows, strict=True):
            axes.barh(y, row["range"] or 0.0, 0.7, color=AFTER if row["stands_out"] else "#9dbad5")  # pyright: ignore
            if row["range_of_noise"] is not None:
                axes.plot([row["range_of_noise"]] * 2, [y - 0.42, y + 0.42], color=BEFORE, lw=1.6)  # pyright: ignore
        axes.set_yticks(place, [str(row["name"]) for row in rows])
        axes.set_xlabel("range of the mean accuracy over levels (Eq. 15); red: 95 % of what noise alone shows")

    return svg(draw, 7.2, 0.24 * len(rows) + 0.9)


def course_figure(record: CalibrationRecord) -> str:
    """Return accuracy against runs: every candidate, and the best of each stage so far."""
    colors = {"stage1": "#7f7f7f", "stage2_exploration": "#e08a1e", "stage2_optimisation": AFTER,
              "confirmation": "#2a9d5c"}  # fmt: skip

    def draw(axes: Axes) -> None:
        seen = set()
        lowest = 1.0
        for entry in record.found.course:
            color = colors.get(entry.stage, FIELD)
            accuracy = np.asarray(entry.accuracy, float)
            label = entry.stage.replace("_", " ") if entry.stage not in seen else None
            seen.add(entry.stage)
            axes.plot(np.full(len(accuracy), entry.num_runs), accuracy, ".", color=color, ms=3, alpha=0.5)
            axes.plot(entry.num_runs, np.nanmedian(accuracy), "_", color=color, ms=12, mew=2, label=label)
            lowest = min(lowest, float(np.nanquantile(accuracy, 0.1)))
        axes.axhline(record.found.objective.noise_floor_accuracy, color=BEFORE, lw=1.0, ls="--",
                     label="accuracy of the truth, on average")  # fmt: skip
        axes.set_ylim(max(lowest, -0.5), 1.0)
        axes.set_xlabel("runs of the surrogate")
        axes.set_ylabel("accuracy")
        axes.legend(frameon=False, fontsize=7, loc="lower right")

    return svg(draw, 7.2, 3.2)


def parameters_figure(record: CalibrationRecord, result: CalibrationResult) -> str:
    """Return each parameter within its bounds: scenario, logs, result with interval."""
    space = record.initial.space
    place = np.arange(len(space.names))[::-1]

    def unit(name: str, value: float | None) -> float:
        values = space.lower.copy()
        values[space.index(name)] = np.nan if value is None else value
        return float(space.unit_of(values)[space.index(name)])

    def draw(axes: Axes) -> None:
        axes.hlines(place, 0.0, 1.0, color=NOISE, lw=5)
        for y, name in zip(place, space.names, strict=True):
            one = result.parameter_table[name]
            if one.lower is not None:
                axes.hlines(y, unit(name, one.lower), unit(name, one.upper), color=AFTER, lw=3, alpha=0.5)
            axes.plot(unit(name, one.scenario), y, "x", color=BEFORE, ms=6)
            axes.plot(unit(name, one.initial), y, "|", color=FIELD, ms=9)
            axes.plot(unit(name, one.value), y, "o", color=AFTER, ms=5)
            bounds = space.ranges[space.index(name)]
            axes.text(-0.01, y, f"{bounds.lower:.4g}", ha="right", va="center", fontsize=7, color="#666666")
            axes.text(1.01, y, f"{bounds.upper:.4g} {bounds.unit}", ha="left", va="center", fontsize=7, color="#666666")
        axes.set_yticks(place, space.names)
        axes.tick_params(axis="y", pad=32, length=0)
        axes.set_xlim(-0.02, 1.02)
        axes.xaxis.set_visible(False)
        axes.spines[["left", "bottom"]].set_visible(False)

    return svg(draw, 7.2, 0.26 * len(space.names) + 0.4)


def timing_figure(result: CalibrationResult) -> str:
    """Return where the time went."""
    parts = {name: wall_s for name, wall_s in result.wall_s.items() if name not in ("total", "corrected_search")}
    place = np.arange(len(parts))[::-1]

    def draw(axes: Axes) -> None:
        axes.barh(place, list(parts.values()), 0.7, color="#9dbad5")
        axes.set_yticks(place, [name.replace("_", " ") for name in parts])
        axes.set_xlabel("s (compilation runs beside the initial values)")

    return svg(draw, 7.2, 0.22 * len(parts) + 0.8)
