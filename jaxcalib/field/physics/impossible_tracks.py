"""Tracks that no vehicle of the traffic can have made: the subject vehicle itself, doubles, oncoming, radar echoes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from jaxcalib.field.physics.contradiction import Contradiction
from jaxcalib.field.physics.motion import DriveMotion

MOST_LEFT_OUT = 0.1  # share of a drive's rows; with more the tables are not what they are said to be
LEAST_TRACK_S = 1.0  # shorter tracks are judged by nobody
MOST_ROWS_SHARE = 0.8  # of a track's rows that must look alike
OWN_LENGTH_M, OWN_WIDTH_M = 2.0, 1.0  # around the subject vehicle's own place
DOUBLE_LENGTH_M, DOUBLE_WIDTH_M = 2.5, 1.2  # half of the smallest car: two vehicles cannot be so near
NEIGHBOURS = 4  # in the order along the road, among which a double is looked for
RATE_S = 0.8  # over which the change of a distance is taken; less than the shortest track that is judged
ONCOMING_MPS = 5.0  # slower ones may be anything
STANDING_MPS = 1.0
PASSED_AT_MPS = 8.0  # the subject vehicle's speed at which something standing is no queue that it is in
MOVING_MPS = 5.0  # of another vehicle that drives through the place
SAME_PLACE_M, SAME_LANE_M, SAME_TIME_S = 2.5, 1.0, 2.0
SENTINEL = 900.0  # metres: numbers beyond, there again and again, stand for nothing
FEWEST_SENTINELS = 3

WORDS: Mapping[str, str] = {
    "subject_itself": "the subject vehicle among its own objects",
    "doubled": "vehicles that are there twice, at one place",
    "oncoming": "oncoming traffic",
    "standing": "standing targets, through which others drive",
    "sentinel": "a number that stands for nothing, in relative_x_m or relative_y_m",
}


@dataclass(frozen=True)
class ImpossibleRows:
    """Which rows of a drive's objects belong to no vehicle of the traffic, and why."""

    by_kind: Mapping[str, Bool[np.ndarray, " row"]]

    @property
    def any(self) -> Bool[np.ndarray, " row"]:
        """Rows to be left out."""
        return np.logical_or.reduce(list(self.by_kind.values()))

    def contradictions(self, motion: DriveMotion) -> list[Contradiction]:
        """One for each kind that there is: a few are left out and told, many are refused."""
        found = []
        for kind, rows in self.by_kind.items():
            number, share = int(rows.sum()), float(np.mean(rows)) if len(rows) else 0.0
            if number:
                is_refused = share > MOST_LEFT_OUT
                what = "expected the traffic alone" if is_refused else "left out"
                words = f"{number} of {len(rows)} rows ({share:.1%}) are {WORDS[kind]}; {what}."
                found.append(Contradiction(kind, motion.objects_file, "", words, (motion.id,), is_refused))
        return found


@dataclass(frozen=True)
class _Tracks:
    """Rows sorted by vehicle and time, and the tracks that they form."""

    order: np.ndarray
    track: np.ndarray  # of each sorted row
    starts: np.ndarray  # first sorted row of each track
    lasts_s: np.ndarray  # from first to last row

    def share_of(self, is_so: np.ndarray) -> np.ndarray:
        """Share of each track's rows, given in sorted order, of which something is true."""
        return np.add.reduceat(is_so.astype(float), self.starts) / np.diff(np.append(self.starts, len(self.order)))

    def rows_of(self, is_track: np.ndarray) -> np.ndarray:
        """Rows of the log that belong to some of the tracks."""
        rows = np.zeros(len(self.order), bool)
        rows[self.order] = is_track[self.track]
        return rows


def impossible_rows(motion: DriveMotion) -> ImpossibleRows:
    """Find the rows of a drive that belong to no vehicle of the traffic."""
    if not len(motion.object_time_s):
        return ImpossibleRows({kind: np.zeros(0, bool) for kind in WORDS})
    tracks = _tracks_of(motion)
    x_m, y_m = motion.relative_x_m[tracks.order], motion.relative_y_m[tracks.order]
    is_own = (np.abs(x_m) < OWN_LENGTH_M) & ~(np.abs(y_m) >= OWN_WIDTH_M)
    lasts = tracks.lasts_s >= LEAST_TRACK_S
    itself = tracks.rows_of(lasts & (tracks.share_of(is_own) > MOST_ROWS_SHARE))
    closing_mps, subject_mps = _closing(motion, tracks)
    speed_mps = motion.object_speed_mps[tracks.order]
    together_mps = speed_mps + subject_mps
    against = (speed_mps > ONCOMING_MPS) & (np.abs(closing_mps + together_mps) < 0.2 * together_mps)
    oncoming = tracks.rows_of(lasts & (tracks.share_of(against) > MOST_ROWS_SHARE))
    stands = (speed_mps < STANDING_MPS) & (subject_mps > PASSED_AT_MPS) & (np.abs(closing_mps + subject_mps) < 2.0)
    standing = tracks.rows_of(lasts & (tracks.share_of(stands) > MOST_ROWS_SHARE))
    sentinel = _is_sentinel(motion.relative_x_m) | _is_sentinel(motion.relative_y_m)
    rest = ~(itself | oncoming | standing | sentinel)
    return ImpossibleRows(
        {
            "subject_itself": itself,
            "doubled": _doubled(motion, rest),
            "oncoming": oncoming,
            "standing": standing & _is_driven_through(motion, standing),
            "sentinel": sentinel,
        }
    )


def _tracks_of(motion: DriveMotion) -> _Tracks:
    order = np.lexsort((motion.object_time_s, motion.vehicle))
    vehicle, time_s = motion.vehicle[order], motion.object_time_s[order]
    is_first = np.diff(vehicle, prepend=vehicle[0] - 1) != 0
    starts = np.flatnonzero(is_first)
    ends = np.append(starts[1:], len(order)) - 1
    return _Tracks(order, np.cumsum(is_first) - 1, starts, time_s[ends] - time_s[starts])


def _closing(motion: DriveMotion, tracks: _Tracks) -> tuple[np.ndarray, np.ndarray]:
    """Change of each row's distance per second, and the subject vehicle's speed, in the order of tracks."""
    time_s, x_m = motion.object_time_s[tracks.order], motion.relative_x_m[tracks.order]
    apart = max(1, round(RATE_S / motion.sampling_s))  # rows: from one to the next, noise outweighs the motion
    unknown = np.full(min(apart, len(x_m)), np.nan)
    is_same = tracks.track[apart:] == tracks.track[:-apart]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(is_same, (x_m[apart:] - x_m[:-apart]) / (time_s[apart:] - time_s[:-apart]), np.nan)
    after, before = np.concatenate([rate, unknown]), np.concatenate([unknown, rate])
    closing_mps = np.where(np.isfinite(after), after, before)
    return closing_mps, np.interp(time_s, motion.time_s, motion.speed_mps)


def _is_sentinel(values: np.ndarray) -> np.ndarray:
    large = np.abs(values) >= SENTINEL
    numbers, count = np.unique(values[large], return_counts=True)
    return large & np.isin(values, numbers[count >= FEWEST_SENTINELS])


def _doubled(motion: DriveMotion, considered: np.ndarray) -> np.ndarray:
    """Rows of the shorter of two tracks that are at one place for nearly all of its life."""
    rows = np.flatnonzero(considered & np.isfinite(motion.relative_x_m))
    rows = rows[np.lexsort((motion.relative_x_m[rows], motion.object_time_s[rows]))]
    time_s, x_m, y_m, vehicle = (
        values[rows] for values in (motion.object_time_s, motion.relative_x_m, motion.relative_y_m, motion.vehicle)
    )
    pairs = []
    for apart in range(1, NEIGHBOURS + 1):
        here, there = slice(None, -apart), slice(apart, None)
        is_near = (time_s[there] == time_s[here]) & (x_m[there] - x_m[here] < DOUBLE_LENGTH_M)
        is_near &= ~(np.abs(y_m[there] - y_m[here]) >= DOUBLE_WIDTH_M)
        pairs.append(np.sort(np.stack([vehicle[here][is_near], vehicle[there][is_near]], axis=1), axis=1))
    found, times = np.unique(np.concatenate(pairs), axis=0, return_counts=True)
    num_rows = np.bincount(motion.vehicle, minlength=int(motion.vehicle.max()) + 1)
    least = LEAST_TRACK_S / motion.sampling_s
    doubled: set[int] = set()
    for (first, second), together in zip(found.tolist(), times.tolist(), strict=True):
        shorter = first if num_rows[first] < num_rows[second] else second
        if together >= max(least, MOST_ROWS_SHARE * num_rows[shorter]) and not {first, second} & doubled:
            doubled.add(shorter)
    return considered & np.isin(motion.vehicle, sorted(doubled))


def _is_driven_through(motion: DriveMotion, standing: np.ndarray) -> np.ndarray:
    """Whether the subject vehicle or another one drives through what stands there, for each of its rows."""
    place_m = np.interp(motion.object_time_s, motion.time_s, motion.position_m) + motion.relative_x_m
    across_m = np.interp(motion.object_time_s, motion.time_s, motion.across_m) + motion.relative_y_m
    moving = np.flatnonzero((motion.object_speed_mps > MOVING_MPS) & np.isfinite(place_m) & np.isfinite(across_m))
    moving = moving[np.argsort(place_m[moving])]
    through = np.zeros(len(standing), bool)
    for vehicle in np.unique(motion.vehicle[standing]):
        rows = np.flatnonzero(standing & (motion.vehicle == vehicle))
        is_met = (np.abs(motion.relative_x_m[rows]) < SAME_PLACE_M) & (np.abs(motion.relative_y_m[rows]) < SAME_LANE_M)
        at_m, beside_m = float(np.nanmedian(place_m[rows])), float(np.nanmedian(across_m[rows]))
        begin, end = np.searchsorted(place_m[moving], [at_m - SAME_PLACE_M, at_m + SAME_PLACE_M])
        there = moving[begin:end]
        first_s, last_s = motion.object_time_s[rows].min() - SAME_TIME_S, motion.object_time_s[rows].max() + SAME_TIME_S
        is_then = (motion.object_time_s[there] >= first_s) & (motion.object_time_s[there] <= last_s)
        through[rows] = is_met.any() or np.any(is_then & (np.abs(across_m[there] - beside_m) < SAME_LANE_M))
    return through
