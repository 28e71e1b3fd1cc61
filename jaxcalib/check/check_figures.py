"""Figures of what was understood of a case's logs: a map, and panels for each drive."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxcalib.check.check_records import NUMBER_OF, STAYS, DriveRecord, LogRecords
from jaxcalib.check.check_road import evenly
from jaxcalib.html.drawing import BEFORE, FIELD, STYLE, svg, svg_text
from sim_adapters.units import kmh_from_mps

WIDTH_IN = 11.0
PICTURE: dict[Any, Any] = {
    "savefig.dpi": 80
}  # of clouds of points, which are pictures within a figure; the rest is drawn in lines
MOST_POINTS, MOST_LEFT_OUT = 3000, 1000  # of a cloud: rows that stay, and rows that are left out
HIGHEST_SPEED_KMH = 250.0  # of what is drawn
NOTABLE = 0.05  # by which speeds of places and logged ones differ
HIGHEST_MAP = 0.4  # of its width
FULL_COLOUR_MPS = 30.0 / 3.6
SLOWER, ALIKE, FASTER = "#c00000", "#b0b0b0", "#0040ff"  # than the subject vehicle
SPEED_COLOURS = LinearSegmentedColormap.from_list("faster", [SLOWER, ALIKE, FASTER], 32)
# Of the kinds of rows that are left out, none of them red, blue or grey; and of drives.
KIND_COLOURS: Mapping[str, str] = {
    "subject_itself": "#000000",
    "doubled": "#e6a700",
    "oncoming": "#ff2ad4",
    "standing": "#7a4a1d",
    "sentinel": "#7f00ff",
    "off_route": "#00a878",
    "off_road": "#55c400",
}
DRIVE_COLOURS = (
    "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22", "#003f5c",
    "#ffa600", "#58508d",
)  # fmt: skip
OTHER_COLOUR = "#555555"


def drive_colours(records: LogRecords) -> dict[str, str]:
    """Colour of each drive on the map; one for all beyond those that are shown."""
    shown = [drive.id for drive in records.drives]
    return {
        name: DRIVE_COLOURS[shown.index(name) % len(DRIVE_COLOURS)] if name in shown else OTHER_COLOUR
        for name in records.ways_xy_m
    }


def map_figure(records: LogRecords) -> str:
    """Return the lanes of the road, grey, and the drives' places: a dot where they begin, a square where they end.

    Nothing where there is neither.
    """
    ways = {name: xy_m[np.isfinite(xy_m[:, 0])] for name, xy_m in records.ways_xy_m.items()}
    parts = [points for points in (*records.lanes_xy_m, *ways.values()) if len(points)]
    if not parts:
        return ""
    low, high = (extreme(np.concatenate(parts), axis=0) for extreme in (np.nanmin, np.nanmax))
    middle, wide_m = (low + high) / 2.0, 1.06 * float(max(*(high - low), 20.0))
    share = float(np.clip((high[1] - low[1] + 0.08 * wide_m) / wide_m, 0.12, HIGHEST_MAP))
    wide_m = max(wide_m, 1.06 * float(high[1] - low[1]) / share)
    colours = drive_colours(records)

    def draw(axes: Axes) -> None:
        for line in records.lanes_xy_m:
            axes.plot(*line.T, color="#c4c4c4", lw=4.0, solid_capstyle="butt", zorder=1)
        for number, (name, points) in enumerate(ways.items()):
            axes.plot(*points.T, color=colours[name], lw=0.9, alpha=0.8, zorder=2)
            size = 6.0 - 3.0 * number / max(len(ways) - 1, 1)  # marks at one place stay visible
            for at, mark in ((points[:1], "o"), (points[-1:], "s")):
                axes.plot(*at.T, mark, color=colours[name], ms=size, mec="white", mew=0.4, zorder=3)
        if records.lanes_xy_m:
            lanes = np.concatenate(records.lanes_xy_m)
            extent = np.nanmax(lanes, axis=0) - np.nanmin(lanes, axis=0)
            if max(extent) < 0.05 * wide_m:  # a dot on this map
                axes.annotate("the road", np.nanmean(lanes, axis=0), (8, 8), textcoords="offset points", fontsize=9)
        axes.set_xlim(middle[0] - wide_m / 2, middle[0] + wide_m / 2)
        axes.set_ylim(middle[1] - share * wide_m / 2, middle[1] + share * wide_m / 2)
        axes.set_aspect("equal")
        axes.ticklabel_format(useOffset=False, style="plain")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")

    return svg(draw, WIDTH_IN, share * (WIDTH_IN - 0.8) + 0.6)


def drive_figures(records: LogRecords) -> dict[str, str]:
    """Return for each drive that is shown its speeds, its tracks over time, and what it detected seen from above."""
    figures = {}
    with mpl.rc_context(STYLE | PICTURE):
        figure = Figure(figsize=(WIDTH_IN, 2.5))  # one for all: its axes take longer to make than a drive to draw
        places = [(left, 0.19, width, 0.69) for left, width in ((0.05, 0.25), (0.36, 0.29), (0.71, 0.28))]
        all_axes = [figure.add_axes(place) for place in places]
        for axes in all_axes:
            axes.xaxis.set_major_locator(MaxNLocator(5))
            axes.yaxis.set_major_locator(MaxNLocator(5))
        for drive in records.drives:
            for axes, panel in zip(all_axes, (_speeds, _tracks, _from_above), strict=True):
                for artist in (*axes.lines, *axes.collections, *axes.texts):
                    artist.remove()
                panel(axes, drive, records)
            figures[drive.id] = svg_text(figure)
    return figures


def _speeds(axes: Axes, drive: DriveRecord, _: LogRecords) -> None:
    rows = evenly(drive.time_s)
    logged_kmh, shown_kmh = (kmh_from_mps(speed[rows]) for speed in (drive.speed_mps, drive.shown_speed_mps))
    axes.plot(drive.time_s[rows], shown_kmh, color=BEFORE, lw=1.8, alpha=0.6)
    axes.plot(drive.time_s[rows], logged_kmh, color=FIELD, lw=0.9)
    known = np.concatenate([logged_kmh, shown_kmh])
    known = known[np.isfinite(known)]
    top_kmh = 1.15 * float(np.quantile(known, 0.995)) if len(known) else 1.0
    axes.set_ylim(
        float(np.clip(np.min(known, initial=0.0), -20.0, 0.0)), float(np.clip(top_kmh, 10.0, HIGHEST_SPEED_KMH))
    )
    for words, colour, at in (("logged", FIELD, 0.02), ("by the places", BEFORE, 0.2)):
        axes.text(at, 0.04, words, color=colour, transform=axes.transAxes, fontsize=8)
    times = drive.shown_over_logged
    told = f"places show {times:.2f} x the logged speed" if np.isfinite(times) else "speed"
    _name(axes, told, "time [s]", "speed [km/h]")
    is_notable = abs(times - 1.0) > NOTABLE
    axes.title.set(color=BEFORE if is_notable else FIELD, weight="bold" if is_notable else "normal")
    axes.set_xlim(*_times(drive))


def _tracks(axes: Axes, drive: DriveRecord, records: LogRecords) -> None:
    ranges = (-records.behind_m, records.ahead_m)
    limits = _limits(drive.relative_x_m, *ranges)
    for at_m in ranges:
        axes.axhline(at_m, color=FIELD, lw=0.6, ls=":")
    axes.axhline(0.0, color=FIELD, lw=0.6)
    _cloud(axes, drive, drive.object_time_s, np.clip(drive.relative_x_m, *limits))
    axes.set_xlim(*_times(drive))
    axes.set_ylim(*limits)
    _name(axes, "tracks: distance over time", "time [s]", "relative_x [m], + ahead")


def _from_above(axes: Axes, drive: DriveRecord, records: LogRecords) -> None:
    has_lanes = bool(records.borders_m) and drive.has_lanes
    if has_lanes:
        for border_m, share in records.borders_m.items():
            axes.axhline(border_m, color="#8a8a8a", lw=0.4 + 0.8 * min(share, 1.0), zorder=0)
    borders_m = list(records.borders_m) if has_lanes else [0.0]
    limits_x = _limits(drive.relative_x_m, -records.behind_m, records.ahead_m)
    limits_y = _limits(drive.across_m, min(borders_m) - 2.0, max(borders_m) + 2.0)
    _cloud(axes, drive, np.clip(drive.relative_x_m, *limits_x), np.clip(drive.across_m, *limits_y))
    own = np.unique(np.round(drive.own_across_m[np.isfinite(drive.own_across_m)], 1))
    axes.plot(np.zeros(len(own)), np.clip(own, *limits_y), "s", color=FIELD, ms=2.5, zorder=4)
    axes.set_xlim(*limits_x)
    axes.set_ylim(*limits_y)
    across = "across the road [m], + left" if has_lanes else "relative_y [m], + left"
    _name(axes, "seen from above", "relative_x [m], + ahead", across)


def _name(axes: Axes, title: str, across: str, along: str) -> None:
    axes.set_title(title, y=1.0)
    axes.set_xlabel(across, labelpad=1.0)
    axes.set_ylabel(along, labelpad=1.0)


def _cloud(axes: Axes, drive: DriveRecord, x: np.ndarray, y: np.ndarray) -> None:
    """Draw objects: those that stay by how much faster they are, the others over them in the colour of their kind."""
    is_known = np.isfinite(x) & np.isfinite(y)
    rows = np.flatnonzero(is_known & (drive.kind == STAYS))
    rows = rows[thinned(len(rows), MOST_POINTS)]
    axes.scatter(
        x[rows], y[rows], c=np.nan_to_num(drive.faster_mps[rows]), cmap=SPEED_COLOURS, s=3.0, lw=0, rasterized=True,
        vmin=-FULL_COLOUR_MPS, vmax=FULL_COLOUR_MPS,
    )  # fmt: skip
    for kind, number in NUMBER_OF.items():
        rows = np.flatnonzero(is_known & (drive.kind == number))
        rows = rows[thinned(len(rows), MOST_LEFT_OUT // len(NUMBER_OF))]
        if len(rows):
            axes.plot(x[rows], y[rows], "x", color=KIND_COLOURS[kind], ms=3.0, mew=0.8, rasterized=True)


def _times(drive: DriveRecord) -> tuple[float, float]:
    """Limits of the axes of time: the drive's own, for objects of another time are left out anyway."""
    time_s = drive.time_s if len(drive.time_s) else drive.object_time_s
    first_s, last_s = (float(time_s.min()), float(time_s.max())) if len(time_s) else (0.0, 1.0)
    room_s = 0.03 * max(last_s - first_s, 1.0)
    return first_s - room_s, last_s + room_s


def _limits(values: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Limits of an axis that has room for nearly all values, and for what is between two others."""
    known = values[np.isfinite(values)]
    if len(known):
        least, most = np.quantile(known, (0.005, 0.995))
        low, high = min(low, float(least)), max(high, float(most))
    room = 0.05 * max(high - low, 1.0)
    return low - room, high + room


def thinned(num_rows: int, most: int) -> np.ndarray:
    """Rows of a cloud that are drawn, in their order, picked by chance: even steps would make patterns of their own."""
    if num_rows <= most:
        return np.arange(num_rows)
    return np.sort(np.random.default_rng(0).choice(num_rows, most, replace=False))
