"""What a recorded pair must agree with itself in: the gap changes as leader and follower drive apart or nearer.

Gap and speeds in another unit alike - all of it in feet - contradict nothing, nor does a gap from front to front.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter

from jaxcalib.errors import CaseError
from jaxcalib.pair_fitting.recorded_pairs import STEP_S, RecordedPair

WINDOW_STEPS = 30  # 3 s: gaps are off by some decimetres, which speeds outweigh then
FEWEST_WINDOWS = 6
CLEARLY_BETTER = 0.5  # of what is left unexplained, that another reading must leave at most
MOST_LEFT = 0.35  # of the changes of the gap; with more nothing is explained
LEAST_LEFT_M = 0.5  # per window, by the table's own reading; below it everything agrees
LEAST_CHANGE_M, LEAST_CORRELATION = 1.5, 0.3  # of gap and speeds in a window, with which they have something in common
MUCH_MORE = 5.0  # times the usual change of the gap, by which the speeds miss it
JUMP_M = 6.0  # of the gap in a step, beyond its changes before and after: more than the length of a car
NEIGHBOURS = 9  # steps
HELD_S, HELD_M = 3.0, 3.0  # a gap that stands still for so long while speeds alone would change it by so much
SENTINEL_M = 900.0  # numbers beyond stand for nothing
FOOT_M, KMH, MPH = 0.3048, 1.0 / 3.6, 0.44704


@dataclass(frozen=True)
class Reading:
    """Another meaning of the columns; each number is what a value is to be multiplied by."""

    words: str
    leader: float = 1.0
    follower: float = 1.0
    gap: float = 1.0


class Windows(NamedTuple):
    """A pair, or a table of them, cut into windows of some seconds."""

    changed_m: Float[np.ndarray, " window"]  # change of the gap
    leader_m: Float[np.ndarray, " window"]  # way of the leader by its speeds
    follower_m: Float[np.ndarray, " window"]  # the same of the follower


AS_STATED = Reading("")
READINGS = (
    Reading("leader and follower seem to be exchanged", -1.0, -1.0),
    Reading("the gap seems to be in feet", gap=FOOT_M),
    Reading("both speeds seem to be in km/h", KMH, KMH),
    Reading("both speeds seem to be in mph", MPH, MPH),
    Reading("both speeds seem to be in ft/s", FOOT_M, FOOT_M),
    Reading("the leader's speed seems to be in km/h", leader=KMH),
    Reading("the leader's speed seems to be in mph", leader=MPH),
    Reading("the leader's speed seems to be in ft/s", leader=FOOT_M),
    Reading("the follower's speed seems to be in km/h", follower=KMH),
    Reading("the follower's speed seems to be in mph", follower=MPH),
    Reading("the follower's speed seems to be in ft/s", follower=FOOT_M),
    Reading("the leader's speed seems to be relative to the follower's", follower=0.0),
)


def believed_pairs(file: Path, pairs: Sequence[RecordedPair]) -> tuple[list[RecordedPair], list[str]]:
    """Pairs that do not contradict themselves, and a line for each other.

    Args:
        file: their table, for messages.
        pairs: those that can be followed.

    Raises:
        CaseError: all of them together contradict themselves, or no pair is left.
    """
    if words := judge_table(pairs):
        raise CaseError(file, "columns v_lead_mps, v_foll_mps, gap_m", words)
    verdicts = [judge_pair(pair) for pair in pairs]
    left_out = [f"{pair.name}: {words}" for pair, words in zip(pairs, verdicts, strict=True) if words]
    kept = [pair for pair, words in zip(pairs, verdicts, strict=True) if words is None]
    if left_out and not kept:
        raise CaseError(file, "", f"expected a pair that does not contradict itself; {left_out[0]}")
    return kept, left_out


def judge_table(pairs: Sequence[RecordedPair]) -> str | None:
    """What all pairs of a table together contradict themselves in, in one line: units, roles; None where nothing."""
    parts = [_windows(pair) for pair in pairs if _spoilt(pair) is None]
    if not parts:
        return None
    return _other_reading(Windows(*(np.concatenate(of_all) for of_all in zip(*parts, strict=True))))


def judge_pair(pair: RecordedPair) -> str | None:
    """Why a pair is not to be believed, in one line; None where it may be right."""
    windows = _windows(pair)
    return _spoilt(pair) or _other_reading(windows) or _nothing_in_common(windows)


def _other_reading(windows: Windows) -> str | None:
    """The reading that explains the changes of the gap clearly better than what the columns are said to be."""
    changed_m, leader_m, follower_m = windows
    if len(changed_m) < FEWEST_WINDOWS:
        return None

    def left_m(reading: Reading) -> float:
        expected_m = reading.leader * leader_m - reading.follower * follower_m
        return float(np.median(np.abs(reading.gap * changed_m - expected_m))) / reading.gap

    stated_m = left_m(AS_STATED)
    best = min(READINGS, key=left_m)
    most_m = max(MOST_LEFT * float(np.median(np.abs(changed_m))), LEAST_LEFT_M)
    if stated_m <= LEAST_LEFT_M or left_m(best) > min(CLEARLY_BETTER * stated_m, most_m):
        return None
    return f"{best.words}: so the gap changes, and not as the columns say."


def _nothing_in_common(windows: Windows) -> str | None:
    changed_m, leader_m, follower_m = windows
    if len(changed_m) < FEWEST_WINDOWS:
        return None
    apart_m = leader_m - follower_m
    left_m, usual_m = float(np.median(np.abs(changed_m - apart_m))), float(np.median(np.abs(changed_m)))
    if left_m > MUCH_MORE * max(usual_m, LEAST_LEFT_M):
        return f"the speeds would change the gap by {left_m:.0f} m more in {WINDOW_STEPS * STEP_S:g} s than it changes."
    if min(float(np.median(np.abs(changed_m))), float(np.std(apart_m))) < LEAST_CHANGE_M:
        return None
    if np.corrcoef(changed_m, apart_m)[0, 1] >= LEAST_CORRELATION:
        return None
    return "the gap changes by metres, and the speeds have nothing to do with it."


def _spoilt(pair: RecordedPair) -> str | None:
    if pair.gap_m.max() >= SENTINEL_M:
        return f"a gap of {pair.gap_m.max():g} m stands for nothing; leave such rows out."
    return _jump(pair) or _held(pair)


def _jump(pair: RecordedPair) -> str | None:
    """A gap that becomes another one at once."""
    step_m = np.diff(pair.gap_m)
    beyond_m = np.abs(step_m - median_filter(step_m, size=NEIGHBOURS, mode="nearest"))
    at = int(np.argmax(beyond_m))
    if beyond_m[at] <= JUMP_M:
        return None
    return f"the gap jumps by {step_m[at]:.1f} m after {at * STEP_S:.1f} s: another leader; cut the pair there."


def _held(pair: RecordedPair) -> str | None:
    """A gap that keeps a value for seconds although the speeds differ: clamped, or held while nothing was seen."""
    begins = np.flatnonzero(np.diff(pair.gap_m, prepend=np.nan) != 0.0)
    ends = np.append(begins[1:], len(pair))
    driven_m = np.concatenate([[0.0], np.cumsum(STEP_S * (pair.leader_mps - pair.follower_mps))])
    is_long = np.flatnonzero((ends - begins) * STEP_S >= HELD_S)
    held = [int(begins[at]) for at in is_long if np.ptp(driven_m[begins[at] : ends[at] + 1]) >= HELD_M]
    if not held:
        return None
    where = f"the gap stays at {pair.gap_m[held[0]]:g} m from {held[0] * STEP_S:.1f} s on"
    return f"{where} while the speeds differ: clamped, or held."


def _windows(pair: RecordedPair) -> Windows:
    """Change of the gap in each window, and the ways of leader and follower."""
    edges = np.arange(0, len(pair), WINDOW_STEPS)
    ways = [
        np.concatenate([[0.0], np.cumsum(STEP_S * (v[1:] + v[:-1]) / 2.0)])
        for v in (pair.leader_mps, pair.follower_mps)
    ]
    return Windows(np.diff(pair.gap_m[edges]), *(np.diff(way[edges]) for way in ways))
