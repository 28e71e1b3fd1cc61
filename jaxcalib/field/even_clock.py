"""Brings a drive to an even clock whose instants are the multiples of an interval."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.field.log_tables import CLOCK_TOLERANCE_S
from sim_adapters.frame_table import ObjectTable, SubjectTable


@dataclass(frozen=True)
class EvenDrive:
    """A drive on an even clock."""

    subject: SubjectTable  # the subject vehicle at every instant from its first to its last sample
    objects: ObjectTable  # the detected vehicles
    valid: np.ndarray  # False at instants in a gap of the subject vehicle's log; its values there are only placeholders


@dataclass(frozen=True)
class _Between:
    """Instants of the clock between samples."""

    instant: np.ndarray  # number of the instant, counted from time 0
    before: np.ndarray  # sample before it
    after: np.ndarray  # sample after it, the same if a sample lies on the instant
    share: np.ndarray  # share of the way from the one to the other

    def linear(self, values: np.ndarray) -> np.ndarray:
        """Interpolate; a sample on the instant is taken as it is, even if its neighbour is nan."""
        here, there = values[self.before], values[self.after]
        return np.where(self.before == self.after, here, here + self.share * (there - here))

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """Return the value of the nearest sample."""
        return np.where(self.share <= 0.5, values[self.before], values[self.after])

    def linear_in_row(self, values: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Interpolate what is measured from the lane's centre: only between samples in one lane."""
        return np.where(row[self.before] == row[self.after], self.linear(values), self.nearest(values))


@dataclass(frozen=True)
class _OnClock:
    """Where samples lie on the clock: one decision for each, so that no instant is lost or taken twice."""

    is_on: np.ndarray  # whether a sample counts as on an instant
    first_from: np.ndarray  # number of the first instant that is not before it
    last_until: np.ndarray  # number of the last instant that is not after it

    @classmethod
    def of(cls, time_s: np.ndarray, interval_s: float) -> "_OnClock":
        nearest = np.round(time_s / interval_s)
        is_on = np.abs(time_s - nearest * interval_s) <= CLOCK_TOLERANCE_S
        first_from, last_until = (
            np.where(is_on, nearest, to_whole(time_s / interval_s)).astype(np.int64) for to_whole in (np.ceil, np.floor)
        )
        return cls(is_on, first_from, last_until)


def to_even_clock(
    subject: SubjectTable, objects: ObjectTable, episode: np.ndarray, interval_s: float, longest_gap_s: float
) -> EvenDrive:
    """Return a drive on an even clock.

    Samples that lie on the clock (within 1 ms) are taken as they are. Between samples positions, speeds and
    accelerations are interpolated linearly and lanes are those of the nearest sample. Nothing is extrapolated, and
    nothing is interpolated across a gap.

    Args:
        subject: the subject vehicle's samples.
        objects: the detected vehicles' samples.
        episode: for each of `objects` the number of its episode; consecutive samples of one episode are bridged.
        interval_s: interval of the clock.
        longest_gap_s: longest time between two samples of the subject vehicle that is bridged.
    """
    steps = np.diff(subject.time_s, prepend=subject.time_s[0])
    samples = _between(subject.time_s, np.cumsum(steps > longest_gap_s), interval_s)
    clock = _OnClock.of(subject.time_s[[0, -1]], interval_s)
    first = int(clock.first_from[0])
    instants = np.arange(first, clock.last_until[1] + 1)
    valid = np.isin(instants, samples.instant)
    held = np.clip(np.searchsorted(subject.time_s, instants * interval_s), 0, len(subject.time_s) - 1)
    index = samples.instant - first

    def fill(values: np.ndarray, interpolated: np.ndarray) -> np.ndarray:
        filled = values[held]
        filled[index] = interpolated
        return filled

    even_subject = SubjectTable(
        time_s=np.round(instants * interval_s, 6),
        position_m=fill(subject.position_m, samples.linear(subject.position_m)),
        speed_mps=fill(subject.speed_mps, samples.linear(subject.speed_mps)),
        acceleration_mps2=fill(subject.acceleration_mps2, samples.linear(subject.acceleration_mps2)),
        row=fill(subject.row, samples.nearest(subject.row)),
        lateral_m=fill(subject.lateral_m, samples.linear_in_row(subject.lateral_m, subject.row)),
        num_lanes=fill(subject.num_lanes, samples.nearest(subject.num_lanes)),
    )
    even_objects = _even_objects(subject, objects, episode, interval_s, first, valid, even_subject.position_m)
    return EvenDrive(even_subject, even_objects, valid)


def _even_objects(
    subject: SubjectTable,
    objects: ObjectTable,
    episode: np.ndarray,
    interval_s: float,
    first: int,
    valid: np.ndarray,
    subject_position_m: np.ndarray,
) -> ObjectTable:
    """Interpolate places on the road, not offsets: the subject vehicle's motion between two samples is known better."""
    time_s = subject.time_s[objects.instant]
    order = np.lexsort((time_s, episode))
    position_m = (subject.position_m[objects.instant] + objects.offset_m)[order]
    row = objects.row[order]
    samples = _between(time_s[order], episode[order], interval_s)
    instant = samples.instant - first
    seen = (instant >= 0) & (instant < len(valid))
    seen &= valid[np.clip(instant, 0, max(len(valid) - 1, 0))] if len(valid) else False
    instant = instant[seen]
    return ObjectTable(
        instant=instant,
        track=objects.track[order][samples.before][seen],
        row=samples.nearest(row)[seen],
        offset_m=samples.linear(position_m)[seen] - subject_position_m[instant],
        speed_mps=samples.linear(objects.speed_mps[order])[seen],
        lateral_m=samples.linear_in_row(objects.lateral_m[order], row)[seen],
    )


def _between(time_s: np.ndarray, group: np.ndarray, interval_s: float) -> _Between:
    """Return the instants on samples and between neighbouring samples of one group; sorted by group and time."""
    clock = _OnClock.of(time_s, interval_s)
    on_clock = np.flatnonzero(clock.is_on)

    left = np.flatnonzero(group[1:] == group[:-1])
    begin, end = clock.last_until[left] + 1, clock.first_from[left + 1] - 1
    count = np.maximum(end - begin + 1, 0)
    before = np.repeat(left, count)
    rank = np.arange(len(before)) - np.repeat(np.cumsum(count) - count, count)
    instant = np.repeat(begin, count) + rank
    share = (instant * interval_s - time_s[before]) / (time_s[before + 1] - time_s[before])

    instant = np.concatenate([clock.first_from[on_clock], instant])
    before, after = np.concatenate([on_clock, before]), np.concatenate([on_clock, before + 1])
    share = np.concatenate([np.zeros(len(on_clock)), share])
    order = np.lexsort((instant, group[before]))
    instant, before, after, share = instant[order], before[order], after[order], share[order]
    same_group = np.diff(group[before], prepend=-2) == 0
    again = same_group & (np.diff(instant, prepend=instant[:1] - 1) == 0)  # two samples within 1 ms of one instant
    return _Between(instant[~again], before[~again], after[~again], share[~again])
