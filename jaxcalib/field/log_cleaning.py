"""Makes tracks of detected vehicles fit to be measured: splits, gaps, fragments, numbers.

Nothing is smoothed here. A measure that needs smoothed speeds or accelerations smooths them itself, causally, and does
so alike for recorded and for simulated drives; smoothing here would make the two sides differ.

The rules, in the order in which they are applied:

1. A jump splits a track: what follows is another vehicle that was given the same id. A jump is a step along the road
   that no two vehicles on one carriageway can make, or a change of speed that stays beyond any brake for several
   samples (tyres allow about 10 m/s^2; one odd sample is noise and splits nothing).
2. A gap of up to 1 s, or one and a half sampling steps of a slow log, is an occlusion or a lost detection and is
   bridged (by the clock, see `jaxcalib.field.even_clock`).
   After a longer gap a new episode begins: nothing is interpolated across it and no event may span it. The track keeps
   its number, for a vehicle that leaves and comes back is the same vehicle.
3. An episode shorter than 1 s is dropped: too short for any measure that needs a neighbour or a change, and the usual
   form of a false detection.
4. Tracks are numbered from 0 by first detection, as the simulators number theirs.
"""

from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.field.log_tables import CLOCK_TOLERANCE_S

SAMPLING_STEPS_BRIDGED = 1.5  # time stamps of slow logs are uneven by some per cent
GAP_TOLERANCE = 0.05  # of the gap: one lost sample at 2 Hz, or one step at 1 Hz, is never exactly 1 s


@dataclass(frozen=True)
class CleaningRules:
    """Limits of the rules."""

    longest_gap_s: float = 1.0  # gaps up to this are bridged
    shortest_episode_s: float = 1.0  # shorter episodes are dropped
    fastest_relative_mps: float = 70.0  # a faster step along the road is a jump
    # shorter sampling steps count as this: errors of position do not shrink with the step
    least_jump_time_s: float = 0.1
    hardest_acceleration_mps2: float = 15.0  # a harder change of speed is a jump if it lasts
    lasting_steps: int = 3  # number of sampling steps over which it must last


def rules_for(sampling_s: float) -> CleaningRules:
    """Return the rules for a log: between rows that come as often as usual there is no gap, however slow it is."""
    usual = CleaningRules()
    return replace(usual, longest_gap_s=max(usual.longest_gap_s, SAMPLING_STEPS_BRIDGED * sampling_s))


@dataclass(frozen=True)
class CleanTracks:
    """What the rules make of the rows."""

    keep: np.ndarray  # whether a row stays
    track: np.ndarray  # number of its track, counting from 0 by first detection; -1 where it does not stay
    episode: np.ndarray  # number of its episode, unique over all tracks; -1 where it does not stay
    num_tracks: int  # tracks that stay
    num_splits: int  # jumps
    num_gaps: int  # gaps that were too long to bridge
    num_fragments: int  # episodes that were dropped


def clean_tracks(
    time_s: np.ndarray, vehicle: np.ndarray, offset_m: np.ndarray, speed_mps: np.ndarray, rules: CleaningRules
) -> CleanTracks:
    """Apply the rules to rows in any order.

    Args:
        time_s: time stamps.
        vehicle: number of the recorded id; at most one row per time stamp and id.
        offset_m: along the road, from the subject vehicle.
        speed_mps: speed.
        rules: limits.
    """
    order = np.lexsort((time_s, vehicle))
    time_s, vehicle, offset_m, speed_mps = time_s[order], vehicle[order], offset_m[order], speed_mps[order]
    if not len(order):
        nothing = np.zeros(0, np.int64)
        return CleanTracks(np.zeros(0, bool), nothing, nothing, 0, 0, 0, 0)
    is_first = np.diff(vehicle, prepend=vehicle[0] - 1) != 0
    is_jump = _jumps(time_s, is_first, offset_m, speed_mps, rules)
    is_gap = ~is_first & ~is_jump & (np.diff(time_s, prepend=time_s[0]) > rules.longest_gap_s * (1 + GAP_TOLERANCE))
    part = np.cumsum(is_first | is_jump) - 1
    episode = np.cumsum(is_first | is_jump | is_gap) - 1

    begins = np.flatnonzero(np.diff(episode, prepend=-1))
    ends = np.append(begins[1:], len(episode)) - 1
    is_short = time_s[ends] - time_s[begins] < rules.shortest_episode_s - CLOCK_TOLERANCE_S
    keep = ~is_short[episode]
    track, num_tracks = _number_by_first_detection(part, keep, time_s, offset_m, vehicle)

    back = np.empty(len(order), np.int64)
    back[order] = np.arange(len(order))
    return CleanTracks(
        keep=keep[back],
        track=track[back],
        episode=np.where(keep, episode, -1)[back],
        num_tracks=num_tracks,
        num_splits=int(is_jump.sum()),
        num_gaps=int(is_gap.sum()),
        num_fragments=int(is_short.sum()),
    )


def _jumps(
    time_s: np.ndarray, is_first: np.ndarray, offset_m: np.ndarray, speed_mps: np.ndarray, rules: CleaningRules
) -> np.ndarray:
    """Whether a row begins with a jump; rows sorted by vehicle and time."""
    step_s = np.diff(time_s, prepend=time_s[0])
    farthest_m = rules.fastest_relative_mps * np.maximum(step_s, rules.least_jump_time_s)
    is_jump = ~is_first & (np.abs(np.diff(offset_m, prepend=offset_m[0])) > farthest_m)

    steps = rules.lasting_steps
    if len(time_s) > steps:
        vehicle = np.cumsum(is_first)
        change = np.abs(speed_mps[steps:] - speed_mps[:-steps])
        is_hard = change > rules.hardest_acceleration_mps2 * (time_s[steps:] - time_s[:-steps])
        hard = np.flatnonzero(is_hard & (vehicle[steps:] == vehicle[:-steps]))
        window = hard[:, None] + np.arange(1, steps + 1)
        largest = np.argmax(np.abs(np.diff(speed_mps, prepend=speed_mps[0]))[window], axis=1)
        is_jump[window[np.arange(len(hard)), largest]] = True
    return is_jump


def _number_by_first_detection(
    part: np.ndarray, keep: np.ndarray, time_s: np.ndarray, offset_m: np.ndarray, vehicle: np.ndarray
) -> tuple[np.ndarray, int]:
    """Number parts by the time of their first row that stays; of those first seen together the foremost comes first."""
    rows = np.flatnonzero(keep)
    parts, first = np.unique(part[rows], return_index=True)
    first = rows[first]
    number = np.empty(len(parts), np.int64)
    number[np.lexsort((vehicle[first], -offset_m[first], time_s[first]))] = np.arange(len(parts))
    track = np.full(len(part), -1)
    track[rows] = number[np.searchsorted(parts, part[rows])]
    return track, len(parts)
