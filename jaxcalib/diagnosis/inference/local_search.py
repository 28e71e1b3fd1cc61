"""Where and when a local effect may be: the stretches at which the field departs most from the simulation."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.windows import Window

WIDTHS = (1, 2, 3, 4)  # in stretches
BEST = 2
LEAST_PERIOD_S = 120.0


def persistent_windows(difference: np.ndarray, null: NullModel, road: Conventions) -> tuple[list[Window], int]:
    """Return the best places for an effect that is always there, and how many independent ones were looked at.

    Residuals of car-following by place decide, all regimes together: whatever slows drivers at a place shows there.
    """
    borders = road.stretch_m
    number = len(borders) - 1
    member = np.full(len(null.cells), -1)
    for place, cell in enumerate(null.cells):
        if cell.channel == "replay" and cell.from_m is not None and cell.measure == "residual_mps2":
            index = int(np.argmin(np.abs(borders - cell.from_m)))
            if abs(borders[index] - cell.from_m) < 1.0 and cell.regime in ("slow", "fast"):
                member[place] = index
    weight = 1.0 / np.where(np.diag(null.covariance) > 0, np.diag(null.covariance), 1.0)
    found = []
    for width in WIDTHS:
        for begin in range(number - width + 1):
            inside = (member >= begin) & (member < begin + width)
            if inside.any():
                found.append((_score(difference, null, inside * weight), begin, begin + width))
    return _best(found, lambda begin, end, sign: Window(float(borders[begin]), float(borders[end]), sign=sign)), number


def passing_windows(difference: np.ndarray, null: NullModel, road: Conventions) -> tuple[list[Window], int]:
    """Return the best places and times for an effect that comes and goes; speeds by place and time decide."""
    by_time = [
        (index, cell.from_m, cell.to_m, cell.from_s)
        for index, cell in enumerate(null.cells)
        if cell.regime == "by time" and cell.from_m is not None and cell.to_m is not None and cell.from_s is not None
    ]
    if not by_time:
        return [], 1
    starts_m, starts_s = sorted({one[1] for one in by_time}), sorted({one[3] for one in by_time})
    places, times = np.full((2, len(null.cells)), -1)
    end_m: dict[int, float] = {}
    for index, from_m, to_m, from_s in by_time:
        places[index], times[index] = starts_m.index(from_m), starts_s.index(from_s)
        end_m[int(places[index])] = to_m
    period_s = float(np.diff(road.period_s[:2])[0])
    span = max(1, round(LEAST_PERIOD_S / period_s))
    found = []
    for place in range(len(starts_m)):
        for length in (span, 2 * span):
            for time in range(len(starts_s) - length + 1):
                inside = (places == place) & (times >= time) & (times < time + length)
                if inside.sum():
                    found.append(
                        (_score(difference, null, inside.astype(float)), (place, time), (place, time + length))
                    )
    windows = []
    for score, (place, time), (_, end) in sorted(found, key=lambda one: one[0]):
        until_s = starts_s[time] + (end - time) * period_s
        window = Window(float(starts_m[place]), end_m[place], float(starts_s[time]), float(until_s))
        if score < 0.0 and not any(_overlap(window, other) for other in windows):
            windows.append(window)
        if len(windows) == BEST:
            break
    return windows, max(1, len(starts_m) * len(starts_s) // 2)


def _score(difference: np.ndarray, null: NullModel, weight: np.ndarray) -> float:
    """Return a weighted sum of differences in units of its own deviation."""
    total = float(weight @ difference)
    variance = float(weight @ null.covariance @ weight)
    return total / np.sqrt(variance) if variance > 0 else 0.0


def _overlap(one: Window, other: Window) -> bool:
    is_place = one.from_m < other.to_m and other.from_m < one.to_m
    if one.from_s is None or one.to_s is None or other.from_s is None or other.to_s is None:
        return is_place
    return is_place and one.from_s < other.to_s and other.from_s < one.to_s


def _best(found: Sequence[tuple[float, int, int]], window_of) -> list[Window]:
    windows: list[Window] = []
    for score, begin, end in sorted(found, key=lambda one: -abs(one[0])):
        window = window_of(begin, end, -float(np.sign(score)) or 1.0)
        if not any(_overlap(window, other) for other in windows):
            windows.append(window)
        if len(windows) == BEST:
            break
    return windows


def windows_of_effects(
    difference: np.ndarray, null: NullModel, road: Conventions
) -> tuple[dict[str, list[Window]], dict[str, int]]:
    """Return the windows in which each local effect is tried, and how many were looked at for it."""
    persistent, num_places = persistent_windows(difference, null, road)
    passing, num_moments = passing_windows(difference, null, road)
    lanes = sorted({int(lane) for lane in road.lane_from_left})
    blocked = [
        Window((window.from_m + window.to_m) / 2, (window.from_m + window.to_m) / 2, window.from_s, window.to_s, lane)
        for window in passing
        for lane in (lanes[0], lanes[min(2, len(lanes) - 1)])
    ]
    windows = {
        "grade": persistent,
        "local_speed_reduction": [window for window in persistent if window.sign > 0],
        "rubbernecking": passing,
        "blockage": blocked,
    }
    counts = {
        "grade": num_places,
        "local_speed_reduction": num_places,
        "rubbernecking": num_moments,
        "blockage": num_moments * len(lanes),
    }
    return windows, counts
