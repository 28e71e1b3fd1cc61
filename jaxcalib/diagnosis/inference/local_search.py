"""Where and when a local effect may be: the stretches at which the field departs most from the simulation."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.windows import Window
from surrogate.effects.base import Effect, SearchedAt
from surrogate.effects.registry import EFFECTS

WIDTHS = (1, 2, 3, 4)  # in stretches
BEST = 2
LEAST_PERIOD_S = 120.0
BLOCKED_LANES = (0, 2)  # the leftmost and the third from the left, or the last there is
Feature = Float[np.ndarray, " feature"]


def windows_of_effects(
    difference: Feature, null: NullModel, road: Conventions
) -> tuple[dict[str, list[Window]], dict[str, int]]:
    """The windows in which each local effect is tried, and how many independent ones were looked at for it."""
    scored, num_stretches = stretch_scores(difference, null, road)
    slower, num_spells = spell_windows(difference, null, road)
    windows: dict[str, list[Window]] = {}
    num_looked_at: dict[str, int] = {}
    for effect in EFFECTS:
        if effect.searched_at is SearchedAt.STRETCHES:
            suiting = _best_apart([(score, window) for score, window in scored if _suits(effect, window)])
            # what is always there shows in speeds, too, and where its traffic is dense it does so at times only
            at_times = [replace(window, from_s=None, to_s=None) for window in slower if _suits(effect, window)]
            windows[effect.name] = _apart([*suiting, *at_times])
            num_looked_at[effect.name] = num_stretches
        if effect.searched_at is SearchedAt.LANE_POINTS:
            lanes = sorted({int(lane) for lane in road.lane_from_left})
            windows[effect.name] = lane_points(slower, lanes)
            num_looked_at[effect.name] = num_spells * len(lanes)
        if effect.searched_at is SearchedAt.SPELLS:
            may_be_faster = effect.is_signed or effect.speeds_up
            faster = spell_windows(difference, null, road, sign=-1.0)[0] if may_be_faster else []
            spells = [window for window in (*slower, *faster) if _suits(effect, window)]
            windows[effect.name] = spells if effect.has_place else [_everywhere(window, road) for window in spells]
            num_looked_at[effect.name] = num_spells * (2 if effect.is_signed else 1)
    return windows, num_looked_at


def _suits(effect: Effect, window: Window) -> bool:
    """Whether an effect changes speeds in a window's direction."""
    return effect.is_signed or window.sign == effect.slows


def _everywhere(window: Window, road: Conventions) -> Window:
    return replace(window, from_m=float(road.stretch_m[0]), to_m=float(road.stretch_m[-1]))


def lane_points(windows: Sequence[Window], lanes: Sequence[int]) -> list[Window]:
    """The middles of windows, in some of the lanes."""
    middles = [(0.5 * (window.from_m + window.to_m), window) for window in windows]
    return [
        Window(middle_m, middle_m, window.from_s, window.to_s, lanes[min(number, len(lanes) - 1)])
        for middle_m, window in middles
        for number in BLOCKED_LANES
    ]


def stretch_scores(difference: Feature, null: NullModel, road: Conventions) -> tuple[list[tuple[float, Window]], int]:
    """Stretches for an effect that is always there, each with its score, and how many independent ones there are.

    Residuals of car-following by stretch decide, all regimes together: whatever slows drivers somewhere shows there.
    """
    borders = road.stretch_m
    num_stretches = len(borders) - 1
    member = np.full(len(null.cells), -1)
    for feature, cell in enumerate(null.cells):
        if cell.locates == SearchedAt.STRETCHES and cell.from_m is not None:
            member[feature] = int(np.argmin(np.abs(borders - cell.from_m)))
    weight = 1.0 / np.where(np.diag(null.covariance) > 0, np.diag(null.covariance), 1.0)
    scored = []
    for width in WIDTHS:
        for begin in range(num_stretches - width + 1):
            inside = (member >= begin) & (member < begin + width)
            if inside.any():
                score = _score(difference, null, inside * weight)
                window = Window(float(borders[begin]), float(borders[begin + width]), sign=_sign_of(score))
                scored.append((abs(score), window))
    return scored, num_stretches


def spell_windows(
    difference: Feature, null: NullModel, road: Conventions, sign: float = 1.0
) -> tuple[list[Window], int]:
    """The best stretches and times for an effect that comes and goes; speeds by stretch and time decide.

    With the sign 1 it is where vehicles lose speed, with -1 where they gain.
    """
    by_time = [
        (feature, cell.from_m, cell.to_m, cell.from_s)
        for feature, cell in enumerate(null.cells)
        if cell.locates == SearchedAt.SPELLS
        and cell.from_m is not None
        and cell.to_m is not None
        and cell.from_s is not None
    ]
    if not by_time:
        return [], 1
    starts_m, starts_s = sorted({spell[1] for spell in by_time}), sorted({spell[3] for spell in by_time})
    stretches, times = np.full((2, len(null.cells)), -1)
    end_m: dict[int, float] = {}
    for feature, from_m, to_m, from_s in by_time:
        stretches[feature], times[feature] = starts_m.index(from_m), starts_s.index(from_s)
        end_m[int(stretches[feature])] = to_m
    period_s = float(np.diff(road.period_s[:2])[0])
    span = max(1, round(LEAST_PERIOD_S / period_s))
    scored = []
    for stretch, from_m in enumerate(starts_m):
        for length in (span, 2 * span):
            for time in range(len(starts_s) - length + 1):
                inside = (stretches == stretch) & (times >= time) & (times < time + length)
                score = -sign * _score(difference, null, inside.astype(float)) if inside.any() else 0.0
                until_s = float(starts_s[time] + length * period_s)
                if score > 0.0:
                    window = Window(float(from_m), end_m[stretch], float(starts_s[time]), until_s, sign=sign)
                    scored.append((score, window))
    return _best_apart(scored), max(1, len(starts_m) * len(starts_s) // 2)


def _score(difference: Feature, null: NullModel, weight: Feature) -> float:
    """A weighted sum of differences in units of its own deviation."""
    total = float(weight @ difference)
    variance = float(weight @ null.covariance @ weight)
    return total / np.sqrt(variance) if variance > 0 else 0.0


def _sign_of(score: float) -> float:
    return -float(np.sign(score)) or 1.0


def _overlap(window: Window, other: Window) -> bool:
    meets = window.from_m < other.to_m and other.from_m < window.to_m
    if window.from_s is None or window.to_s is None or other.from_s is None or other.to_s is None:
        return meets
    return meets and window.from_s < other.to_s and other.from_s < window.to_s


def _best_apart(scored: Sequence[tuple[float, Window]]) -> list[Window]:
    """The windows of the highest scores that do not overlap."""
    return _apart([window for _, window in sorted(scored, key=lambda pair: -pair[0])])[:BEST]


def _apart(windows: Sequence[Window]) -> list[Window]:
    """The windows that overlap none before them."""
    chosen: list[Window] = []
    for window in windows:
        if not any(_overlap(window, other) for other in chosen):
            chosen.append(window)
    return chosen
