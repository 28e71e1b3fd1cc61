"""Logs as automated vehicles would have recorded them, had chosen vehicles of a recording been such."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import pandas as pd

from jaxcalib.errors import CaseError, quote
from jaxcalib.field.log_tables import OBJECT_COLUMNS, SUBJECT_COLUMNS
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import USUAL_BEGIN_S, USUAL_RANGE_M, ImportedDrive, ImportOptions
from jaxcalib.importers.occlusion import visible_from_origin
from jaxcalib.importers.recorded_drive import with_places
from jaxcalib.importers.recorded_stretch import (
    FARTHEST_ASIDE_M,
    LEAST_REMAINING,
    Place,
    RecordedStretch,
    range_of,
    road_ends_m,
    widen,
)
from jaxcalib.importers.trajectories import Recording, Slice
from sim_adapters.units import kmh_from_mps

LEAST_STEP_S = 0.1  # between the rows of a probe; denser recordings are thinned
LONG_DRIVE = 0.6  # of the time that a long stay takes: shorter ones are no probes
LONG_STAY = 90.0  # percentile
LEAST_DRIVE_S = 5.0
Item = TypeVar("Item")


@dataclass
class _Stay:
    """When a vehicle is there."""

    first_s: float
    last_s: float
    first: Place  # where
    last: Place

    @property
    def lasts_s(self) -> float:
        """How long."""
        return self.last_s - self.first_s

    @property
    def driven_m(self) -> float:
        """How far its last place is from its first."""
        return float(np.hypot(self.last[0] - self.first[0], self.last[1] - self.first[1]))


@dataclass
class _Rows:
    """What a probe has recorded so far."""

    stretch: RecordedStretch
    subject: list[tuple[float, ...]] = field(default_factory=list)
    objects: list[Frame] = field(default_factory=list)

    @property
    def lasts_s(self) -> float:
        """How long."""
        return self.subject[-1][0] - self.subject[0][0] if self.subject else 0.0

    def cut(self, range_m: float) -> None:
        """Keep whom sensors see, and the rows for whose whole range the road was recorded."""
        kept = np.flatnonzero(self.stretch.has_room(range_m))
        self.subject = [self.subject[row] for row in kept]
        self.objects = [self.objects[row][self.objects[row]["away_m"] <= range_m] for row in kept]


def virtual_probes(recordings: Sequence[Recording], options: ImportOptions) -> tuple[list[ImportedDrive], str]:
    """Make drives of chosen vehicles; they come in the order of time, with a line on the range of their sensors.

    A recording is read twice, slice by slice, so it may be longer than memory. Rows count where the road was recorded
    for the whole range ahead and behind: beyond the recording nobody is seen who is there all the same.

    Args:
        recordings: of one road; each begins at the same time on the scenario's clock unless it has that clock.
        options: how many vehicles are taken, or which, and what they see.

    Raises:
        CaseError: a vehicle that is asked for is not there, nobody stays long enough, or sensors see too far.
    """
    nobody = CaseError("command line", "SOURCE", f"expected a vehicle that stays for {LEAST_DRIVE_S:g} s at least.")
    probes: list[tuple[str, _Rows, Recording]] = []
    missing, some = set(options.subjects), ""
    for recording in recordings:
        stays = _stays(recording)
        missing, some = missing - set(stays), some or ", ".join(list(stays)[:10])
        chosen = {vehicle: stays[vehicle] for vehicle in _choose(stays, recording, options)}
        for vehicle, rows in _look_around(recording, chosen, options).items():
            probes.append((f"{recording.id}-{vehicle}" if len(recordings) > 1 else vehicle, rows, recording))
    if not some:
        raise CaseError("command line", "SOURCE", "expected vehicles; the recording has none.")
    if missing:
        expected = f"expected a vehicle of the recording, got {quote(min(missing))}; it has {some} ..."
        raise CaseError("command line", "--subject", expected)
    if not probes:
        raise nobody
    if options.config is not None:
        ends_m = road_ends_m(options.config, recordings[0].crs)
        for _, rows, _ in probes:
            rows.stretch.open_at(ends_m)
    range_m, why = range_of([rows.stretch for _, rows, _ in probes], options.range_m)
    for _, rows, _ in probes:
        rows.cut(range_m)
    kept = [probe for probe in probes if probe[1].lasts_s >= LEAST_REMAINING * LEAST_DRIVE_S]
    if not kept:
        raise nobody
    kept.sort(key=lambda probe: (recordings.index(probe[2]), probe[1].subject[0][0]))
    left_out = (
        f" {len(probes) - len(kept)} of {len(probes)} drives are too short then, and left out."
        if len(kept) < len(probes)
        else ""
    )
    return [_drive(name, rows, recording, range_m, options) for name, rows, recording in kept], why + left_out


def _thinned(recording: Recording) -> Iterator[Slice]:
    last_s = before_s = -np.inf
    for one in recording.slices():
        if one.time_s < before_s:
            expected = f"expected times that rise, got {one.time_s:.10g} after {before_s:.10g} s."
            raise CaseError("command line", "SOURCE", expected)
        before_s = one.time_s
        if one.time_s - last_s >= LEAST_STEP_S - 1e-6:
            last_s = one.time_s
            yield one


def _stays(recording: Recording) -> dict[str, _Stay]:
    """When and where each vehicle is there."""
    stays: dict[str, _Stay] = {}
    for one in _thinned(recording):
        for number, vehicle in enumerate(one.vehicle):
            stay = stays.get(vehicle)
            place = (float(one.x_m[number]), float(one.y_m[number]), float(one.heading_rad[number]))
            if stay is None:
                stays[vehicle] = _Stay(one.time_s, one.time_s, place, place)
            else:
                stay.last_s, stay.last = one.time_s, place
    return stays


def _choose(stays: Mapping[str, _Stay], recording: Recording, options: ImportOptions) -> list[str]:
    """Those that were asked for, or vehicles that stay long, evenly over the recording's time."""
    if options.subjects:
        return [vehicle for vehicle in options.subjects if vehicle in stays]
    return evenly(_able(stays, recording.has_scenario_clock), options.probes)


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """Some of a sequence, evenly over it; all of them where there are no more than are wanted."""
    places = np.unique(np.linspace(0, len(items) - 1, min(most, len(items))).round().astype(int))
    return [items[place] for place in places]


def _able(stays: Mapping[str, _Stay], begins_empty: bool) -> list[str]:
    """Vehicles that drive far, in the order of time: whole drives where there are any, on a road that is filled."""
    if not stays:
        return []
    lasts_s = np.asarray([stay.lasts_s for stay in stays.values()])
    driven_m = np.asarray([stay.driven_m for stay in stays.values()])
    long_s = float(np.percentile(lasts_s, LONG_STAY))
    is_long = lasts_s >= max(LONG_DRIVE * long_s, LEAST_DRIVE_S)
    able = is_long & (driven_m >= LONG_DRIVE * np.percentile(driven_m, LONG_STAY))
    first_s, last_s = (np.asarray([getattr(stay, name) for stay in stays.values()]) for name in ("first_s", "last_s"))
    begin_s, end_s = float(first_s.min()), float(last_s.max())
    wishes = [last_s < end_s]  # whoever is there at the end would have driven on
    if begins_empty:
        wishes.append(first_s >= begin_s + long_s)
    for wished in wishes:
        able = able & wished if np.any(able & wished) else able
    found = [vehicle for vehicle, is_able in zip(stays, able, strict=True) if is_able]
    return sorted(found, key=lambda vehicle: (stays[vehicle].first_s, vehicle))


def _look_around(recording: Recording, chosen: Mapping[str, _Stay], options: ImportOptions) -> dict[str, _Rows]:
    probes = {vehicle: _Rows(RecordedStretch(stay.first, stay.last)) for vehicle, stay in chosen.items()}
    for one in _thinned(recording):
        widen([rows.stretch for rows in probes.values()], one)
        for number in np.flatnonzero(np.isin(one.vehicle, list(chosen))):
            rows = probes[str(one.vehicle[number])]
            rows.subject.append(
                (
                    one.time_s, float(one.x_m[number]), float(one.y_m[number]), float(one.heading_rad[number]),
                    float(one.speed_mps[number]), float(one.acceleration_mps2[number]), float(one.lane[number]),
                )
            )  # fmt: skip
            rows.objects.append(_seen(one, int(number), options))
    for rows in probes.values():
        x_m, y_m = np.asarray(rows.subject).T[1:3]
        rows.stretch.way_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
    return probes


def _seen(one: Slice, number: int, options: ImportOptions) -> Frame:
    """Who is within the range that is asked for, or the widest that is taken otherwise, and how far away."""
    away_x, away_y = one.x_m - one.x_m[number], one.y_m - one.y_m[number]
    cos, sin = np.cos(one.heading_rad[number]), np.sin(one.heading_rad[number])
    ahead_m, left_m = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    away_m = np.hypot(away_x, away_y)
    near = (away_m <= (options.range_m or USUAL_RANGE_M)) & (np.abs(left_m) <= FARTHEST_ASIDE_M)
    near[number] = False
    if options.is_occluded:
        rows = np.flatnonzero(near)
        near[rows] = visible_from_origin(ahead_m[rows], left_m[rows], one.length_m[rows])
    return pd.DataFrame(
        {
            "time_s": one.time_s,
            "vehicle_id": one.vehicle[near].astype(str),
            "x_m": one.x_m[near],
            "y_m": one.y_m[near],
            "speed_kmh": kmh_from_mps(one.speed_mps[near]),
            "lane": one.lane[near],
            "length_m": one.length_m[near],
            "away_m": away_m[near],
        }
    )


def _drive(name: str, rows: _Rows, recording: Recording, range_m: float, options: ImportOptions) -> ImportedDrive:
    time_s, x_m, y_m, heading_rad, speed_mps, acceleration_mps2, lane = np.asarray(rows.subject).T
    begin_s = options.begin_s if options.begin_s is not None else USUAL_BEGIN_S
    later_s = 0.0 if recording.has_scenario_clock else begin_s
    turn = np.gradient(np.unwrap(heading_rad), time_s) if len(time_s) > 1 else np.full(len(time_s), np.nan)
    subject = pd.DataFrame(
        {
            "time_s": time_s + later_s,
            "speed_kmh": kmh_from_mps(speed_mps),
            "yaw_rate_radps": turn,
            "acceleration_mps2": acceleration_mps2,
            "lane": lane,
            "x_m": x_m,
            "y_m": y_m,
        }
    )
    objects = pd.concat(rows.objects, ignore_index=True).drop(columns="away_m")
    objects["time_s"] += later_s
    return ImportedDrive(
        name,
        with_places(subject, recording.crs, SUBJECT_COLUMNS),
        with_places(objects, recording.crs, OBJECT_COLUMNS),
        range_m,
    )
