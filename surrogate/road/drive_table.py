"""A drive as long tables in which each row knows its leader and what became of it a moment later."""

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from surrogate.road.perception import NO_TRACK, PerceptionFrame

NOBODY = -1
RowFlags = Bool[np.ndarray, " row"]
RowValues = Float[np.ndarray, " row"]
RowNumbers = Int[np.ndarray, " row"]


@dataclass(frozen=True)
class LogFormat:
    """What logs of drives hold."""

    ahead_m: float  # range of the sensors ahead
    behind_m: float  # range behind
    place_step_m: float  # rounding of distances
    speed_step_mps: float  # rounding of speeds


@dataclass(frozen=True)
class DriveTable:
    """All vehicles of a drive, the subject vehicle among them; one row per instant and vehicle.

    Rows are sorted by (instant, row of the road, -position), so that a leader is the row before.
    """

    interval_s: float  # time between two instants
    time_s: Float[np.ndarray, " instant"]  # time of each instant
    is_valid: Bool[np.ndarray, " instant"]  # whether the subject vehicle's log has that instant
    subject_acceleration_mps2: Float[np.ndarray, " instant"]  # the subject vehicle's own acceleration at each instant
    subject_speed_mps: Float[np.ndarray, " instant"]  # speed of the subject vehicle at each instant
    instant: RowNumbers  # instant of each row
    track: RowNumbers  # number of the vehicle; NO_TRACK is the subject vehicle
    lane: RowNumbers  # row of the road
    offset_m: RowValues  # front bumper less that of the subject vehicle
    position_m: RowValues  # front bumper along the route
    speed_mps: RowValues
    lateral_m: RowValues  # offset from the centre of the lane, + left

    @property
    def is_subject(self) -> RowFlags:
        """Whether a row is the subject vehicle's."""
        return self.track == NO_TRACK

    @functools.cached_property
    def leader(self) -> RowNumbers:
        """Row of the leader in the own lane; NOBODY where none is in range."""
        rows = np.arange(len(self.instant))
        same = np.zeros(len(rows), bool)
        same[1:] = (np.diff(self.instant) == 0) & (np.diff(self.lane) == 0)
        return np.where(same, rows - 1, NOBODY)

    @functools.cached_property
    def follower(self) -> RowNumbers:
        """Row of the follower in the own lane; NOBODY where none is in range."""
        behind = np.full(len(self.instant), NOBODY)
        has = self.leader >= 0
        behind[self.leader[has]] = np.flatnonzero(has)
        return behind

    @functools.cached_property
    def spacing_m(self) -> RowValues:
        """Leader's front bumper less own; inf where no leader is in range."""
        has = self.leader >= 0
        spacing_m = np.full(len(self.instant), np.inf)
        spacing_m[has] = self.position_m[self.leader[has]] - self.position_m[has]
        return spacing_m

    def gap_m(self, length_m: float) -> RowValues:
        """Leader's rear bumper less own front bumper; inf where no leader is in range.

        Args:
            length_m: of every vehicle, since logs hold none.
        """
        return self.spacing_m - length_m

    @functools.cached_property
    def by_track(self) -> RowNumbers:
        """Order of the rows by (track, instant)."""
        return np.lexsort((self.instant, self.track))

    @functools.cached_property
    def _links(self) -> tuple[RowNumbers, RowNumbers]:
        order = self.by_track
        adjacent = (np.diff(self.track[order]) == 0) & (np.diff(self.instant[order]) == 1)
        before, after = np.full((2, len(order)), NOBODY)
        after[order[:-1][adjacent]] = order[1:][adjacent]
        before[order[1:][adjacent]] = order[:-1][adjacent]
        return before, after

    @property
    def before(self) -> RowNumbers:
        """Row of the same vehicle at the instant before; NOBODY where it was not seen."""
        return self._links[0]

    @property
    def after(self) -> RowNumbers:
        """Row of the same vehicle at the next instant; NOBODY where it is not seen."""
        return self._links[1]

    def later(self, steps: int) -> RowNumbers:
        """Row of the same vehicle some instants later, seen all the while; NOBODY elsewhere."""
        rows = np.arange(len(self.instant))
        link = self.after if steps > 0 else self.before
        for _ in range(abs(steps)):
            rows = np.where(rows >= 0, link[rows], NOBODY)
        return rows

    def since(self, event: RowFlags) -> RowValues:
        """Time since a vehicle's last row with an event; inf where there was none."""
        order = self.by_track
        track = self.track[order]
        number = np.arange(len(order))
        begins = np.diff(track, prepend=track[:1] - 1) != 0
        start = np.maximum.accumulate(np.where(begins, number, 0))
        last = np.maximum.accumulate(np.where(event[order], number, -1))
        time_s = self.time_s[self.instant[order]]
        passed = np.where(last >= start, time_s - time_s[np.maximum(last, 0)], np.inf)
        back = np.empty(len(order))
        back[order] = passed
        return back

    def recent_mean(self, values: RowValues, span_s: float) -> RowValues:
        """Mean of a quantity over what was seen of each vehicle in the last so many seconds."""
        order = self.by_track
        track, number = self.track[order], np.arange(len(order))
        begins = np.diff(track, prepend=track[:1] - 1) != 0
        start = np.maximum.accumulate(np.where(begins, number, 0))
        first = np.maximum(start, number - round(span_s / self.interval_s))
        total = np.concatenate([[0.0], np.cumsum(values[order])])
        back = np.empty(len(order))
        back[order] = (total[number + 1] - total[first]) / (number + 1 - first)
        return back

    def select(self, keep: RowFlags | Int[np.ndarray, " kept"], **changes: Any) -> "DriveTable":
        """A table of some of the rows."""
        arrays = {
            name: getattr(self, name)[keep]
            for name in ("instant", "track", "lane", "offset_m", "position_m", "speed_mps", "lateral_m")
        }
        return replace(self, **(arrays | changes))

    def sorted(self) -> "DriveTable":
        """The table with its rows in order again, after positions have changed."""
        return self.select(np.lexsort((-self.position_m, self.lane, self.instant)))

    def coarser(self, steps: int) -> "DriveTable":
        """Every so many instants, on the multiples of the longer interval."""
        if steps == 1:
            return self
        interval_s = steps * self.interval_s
        number = np.round(self.time_s / self.interval_s).astype(int)
        chosen = number % steps == 0
        place = np.cumsum(chosen) - 1
        keep = chosen[self.instant]
        return self.select(
            keep,
            interval_s=interval_s,
            time_s=self.time_s[chosen],
            is_valid=self.is_valid[chosen],
            subject_acceleration_mps2=self.subject_acceleration_mps2[chosen],
            subject_speed_mps=self.subject_speed_mps[chosen],
            instant=place[self.instant[keep]],
        )


def drive_table(frames: PerceptionFrame, interval_s: float) -> DriveTable:
    """The table of a drive.

    Args:
        frames: its frames, stacked along a leading time axis, NumPy leaves.
        interval_s: time between two frames.
    """
    is_valid = np.asarray(frames.valid, bool)
    seen = np.asarray(frames.object_valid, bool) & is_valid[:, None]
    instant, place = np.nonzero(seen)

    def rows(values: Any, dtype: type = np.float64) -> np.ndarray:
        return np.asarray(values)[instant, place].astype(dtype)

    subject_position_m = np.asarray(frames.subject_position_m, np.float64)
    offset_m = rows(frames.object_offset_m)
    return DriveTable(
        interval_s=interval_s,
        time_s=np.asarray(frames.time_s, np.float64),
        is_valid=is_valid,
        subject_acceleration_mps2=np.asarray(frames.subject_acceleration_mps2, np.float64),
        subject_speed_mps=np.asarray(frames.subject_speed_mps, np.float64),
        instant=instant,
        track=rows(frames.object_track, int),
        lane=rows(frames.object_row, int),
        offset_m=offset_m,
        position_m=subject_position_m[instant] + offset_m,
        speed_mps=rows(frames.object_speed_mps),
        lateral_m=np.nan_to_num(rows(frames.object_lateral_m)),
    )


def as_logged(table: DriveTable, log: LogFormat) -> DriveTable:
    """A simulated drive, rounded as a log rounds it."""
    offset_m = np.round(table.offset_m / log.place_step_m) * log.place_step_m
    return replace(
        table,
        offset_m=offset_m,
        position_m=table.position_m - table.offset_m + offset_m,
        speed_mps=np.round(table.speed_mps / log.speed_step_mps) * log.speed_step_mps,
        subject_speed_mps=np.round(table.subject_speed_mps / log.speed_step_mps) * log.speed_step_mps,
        subject_acceleration_mps2=np.round(table.subject_acceleration_mps2, 3),
    )


def with_offsets(table: DriveTable, offset_m: RowValues, log: LogFormat) -> DriveTable:
    """A drive whose objects are logged at other distances; those that leave the range are gone."""
    moved = replace(table, offset_m=offset_m, position_m=table.position_m - table.offset_m + offset_m)
    is_seen = (offset_m <= log.ahead_m) & (offset_m >= -log.behind_m)
    return as_logged(moved.select(is_seen).sorted(), log)
