"""Effects that can be put into a drive that is there already: what sensors report, and when drivers act.

SUMO's own runs are altered, at the sampling of the log, so that no error of the surrogate enters. The simulator holds
the same effects for its coarser frames (`surrogate.effects`); here they act on whole drives, whose past and future are
known. Alterations named in RHYTHMS leave places as they are and show in identities only.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.drive_table import DriveTable, as_logged

Alteration = Callable[[DriveTable, float, Conventions, np.random.Generator], DriveTable]


def _with_bias(table: DriveTable, strength: float, road: Conventions, random: np.random.Generator) -> DriveTable:
    del random
    return _moved(table, table.offset_m * (1.0 + strength), road)


def _with_noise(table: DriveTable, strength: float, road: Conventions, random: np.random.Generator) -> DriveTable:
    objects = ~table.is_subject
    offset_m = table.offset_m + strength * objects * random.standard_normal(len(table.offset_m))
    speed = np.maximum(table.speed_mps + strength * objects * random.standard_normal(len(table.speed_mps)), 0.0)
    return _moved(replace(table, speed_mps=speed), offset_m, road)


def _late(table: DriveTable, strength: float, road: Conventions, random: np.random.Generator) -> DriveTable:
    del random
    steps = round(strength / table.interval_s)
    if steps == 0:
        return table
    objects = np.flatnonzero(~table.is_subject)
    instant = table.instant[objects] + steps
    objects, instant = objects[instant < len(table.time_s)], instant[instant < len(table.time_s)]
    own = np.flatnonzero(table.is_subject)
    at = np.full(len(table.time_s), -1)
    at[table.instant[own]] = own
    has = at[instant] >= 0
    objects, instant = objects[has], instant[has]
    rows = np.concatenate([objects, own])
    late = table.select(rows, instant=np.concatenate([instant, table.instant[own]]))
    subject_m = np.zeros(len(table.time_s))
    subject_m[table.instant[own]] = table.position_m[own]
    position = subject_m[late.instant] + late.offset_m
    return replace(late, position_m=position).sorted()


def _short(table: DriveTable, strength: float, road: Conventions, random: np.random.Generator) -> DriveTable:
    del random  # single lost frames are bridged when logs are read
    reach = np.where(table.offset_m > 0, road.ahead_m, road.behind_m) * (1.0 - strength)
    return table.select(np.abs(table.offset_m) <= reach)


def _moved(table: DriveTable, offset_m: np.ndarray, road: Conventions) -> DriveTable:
    position_m = table.position_m - table.offset_m + offset_m
    moved = replace(table, offset_m=offset_m, position_m=position_m)
    seen = (offset_m <= road.ahead_m) & (offset_m >= -road.behind_m)
    return as_logged(moved.select(seen).sorted(), road.place_step_m, road.speed_step_mps)


def _acting_at_intervals(
    table: DriveTable, strength: float, road: Conventions, random: np.random.Generator
) -> DriveTable:
    """Speeds between the moments at which a driver acts are linear: the acceleration is held."""
    steps = max(1, round(strength / table.interval_s))
    order = table.by_track
    track, instant = table.track[order], table.instant[order]
    begins = (np.diff(track, prepend=-9) != 0) | (np.diff(instant, prepend=-9) != 1)
    begin = np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))
    end = np.append(np.flatnonzero(begins)[1:], len(order))[np.cumsum(begins) - 1] - 1
    phase = random.integers(0, steps, len(order))[begin]
    since = (instant - instant[begin] + phase) % steps
    first = np.maximum(np.arange(len(order)) - since, begin)
    last = np.minimum(first + np.where(first == begin, steps - phase, steps), end)
    speed = table.speed_mps[order]
    share = np.where(last > first, (np.arange(len(order)) - first) / np.maximum(last - first, 1), 0.0)
    held = speed[first] + share * (speed[last] - speed[first])
    changed = table.speed_mps.copy()
    changed[order] = np.where(track >= 0, held, speed)
    return as_logged(replace(table, speed_mps=changed), road.place_step_m, road.speed_step_mps)


def _subject_acting_at_intervals(
    table: DriveTable, strength: float, road: Conventions, random: np.random.Generator
) -> DriveTable:
    del road
    steps = max(1, round(strength / table.interval_s))
    number = np.arange(len(table.time_s))
    first = np.maximum(number - (number + int(random.integers(0, steps))) % steps, 0)
    return replace(table, subject_acceleration_mps2=table.subject_acceleration_mps2[first])


def _lasting_changes(table: DriveTable, strength: float, road: Conventions, random: np.random.Generator) -> DriveTable:
    """Vehicles are off the centre of their lane from half a duration before they cross to half of it after."""
    del random, road
    before = table.before
    changed = (before >= 0) & (table.lane[np.maximum(before, 0)] != table.lane)
    after_s = table.since(changed)
    mirrored = replace(table, instant=len(table.time_s) - 1 - table.instant, time_s=table.time_s[::-1] * -1.0)
    before_s = mirrored.since(changed)
    away = np.minimum(after_s, before_s) < 0.45 * strength
    return replace(table, lateral_m=np.where(away, 1.0, table.lateral_m))


ALTERATIONS: dict[str, Alteration] = {
    "gap_sensor_bias": _with_bias,
    "sensor_noise": _with_noise,
    "sensor_latency": _late,
    "sensor_range": _short,
}
RHYTHMS: dict[str, Alteration] = {
    "reaction_delay": _acting_at_intervals,
    "subject_actuation_lag": _subject_acting_at_intervals,
    "lane_change_duration": _lasting_changes,
}
