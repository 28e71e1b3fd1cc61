"""The drives that a new case is made of: their tables, as far as a case needs to know them."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jaxcalib.case.case import Role
from jaxcalib.case.log_form import TABLE_1, LogColumn, LogForm
from jaxcalib.errors import CaseError
from jaxcalib.field.log_tables import EmptyLogError, ObjectLog, SubjectLog, read_object_log, read_subject_log

TABLE_SUFFIXES = re.compile(r"(\.csv|\.csv\.gz|\.parquet)$", re.IGNORECASE)
DRIVE_ID = re.compile(r"[^\x00-\x1f\x7f/\\.][^\x00-\x1f\x7f/\\]{0,99}")
HELD_OUT_SHARE = 1 / 3
EARTH_RADIUS_M = 6_371_000.0  # rough distances alone hang on it


@dataclass(frozen=True)
class RecordedDrive:
    """A drive's tables."""

    id: str  # its name
    subject_file: Path  # table of the subject vehicle
    objects_file: Path  # table of the detected vehicles
    log: SubjectLog  # the subject vehicle's table
    ahead_m: float  # farthest object ahead; 0 where there is none
    behind_m: float  # farthest object behind
    time_zero: float | None = None  # value of its tables' time at the scenario's 0; None for what the logs' form says

    @property
    def begin_s(self) -> float:
        """Time of the first row."""
        return float(self.log.time_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last row."""
        return float(self.log.time_s[-1])

    @property
    def driven_m(self) -> float:
        """Distance by speeds; rows without one count as standing."""
        return float(np.sum(np.nan_to_num(self.log.speed_mps[1:]) * np.diff(self.log.time_s)))


def read_recorded_drives(
    tables: Sequence[tuple[Path, Path]], form: LogForm = TABLE_1
) -> tuple[tuple[RecordedDrive, ...], tuple[str, ...]]:
    """Read the tables of drives.

    Args:
        tables: for each drive the subject vehicle's and the objects'.
        form: how they are written.

    Returns:
        The drives, and one line for each that has no rows and is left out.

    Raises:
        CaseError: a table is missing or wrong, or no drive has rows.
    """
    for file in (file for pair in tables for file in pair):
        if not file.is_file():
            raise CaseError("command line", "--drive", f"expected an existing file, got '{file}'.")
    drives, left_out = [], []
    for name, (subject_file, objects_file) in zip(_ids(tables), tables, strict=True):
        try:
            log = read_subject_log(subject_file, form=form)
        except EmptyLogError as error:
            left_out.append(f"drive {name} is left out: {error}")
            continue
        offset_m = _offset_m(log, read_object_log(objects_file, form=form))
        ahead_m, behind_m = (float(np.nanmax(side, initial=0.0)) for side in (offset_m, -offset_m))
        drives.append(RecordedDrive(name, subject_file, objects_file, log, ahead_m, behind_m))
    if not drives:
        raise CaseError("command line", "--drive", f"expected a drive with rows at least; {left_out[0]}")
    return tuple(drives), tuple(left_out)


def put_at(drive: RecordedDrive, begin_s: float, form: LogForm) -> RecordedDrive:
    """A drive whose first row has another time on the scenario's clock."""
    later_s = begin_s - drive.begin_s
    column = form.subject.get("time_s", LogColumn("time_s"))
    log = replace(drive.log, time_s=drive.log.time_s + later_s)
    return replace(drive, log=log, time_zero=column.zero - later_s / column.factor)


def _offset_m(subject: SubjectLog, objects: ObjectLog) -> np.ndarray:
    """Distances along the road, roughly, for objects with places as seen in the direction of travel."""
    if objects.place is None:
        return objects.relative_x_m
    own, theirs = subject.place, objects.place
    if own.kind == "edge" or theirs.kind != own.kind or len(subject.time_s) < 2:
        return np.zeros(0)
    scale = (1.0, 1.0)
    if own.kind == "globe":
        scale = (EARTH_RADIUS_M * math.cos(float(np.nanmedian(own.second))), EARTH_RADIUS_M)
    known = ~own.is_missing
    time_s = subject.time_s[known]
    x_m, y_m = own.first[known].astype(float) * scale[0], own.second[known] * scale[1]
    heading_rad = np.arctan2(np.gradient(y_m), np.gradient(x_m))
    nearest = np.clip(np.searchsorted(time_s, objects.time_s), 0, len(time_s) - 1)
    away_x_m, away_y_m = theirs.first.astype(float) * scale[0] - x_m[nearest], theirs.second * scale[1] - y_m[nearest]
    return away_x_m * np.cos(heading_rad[nearest]) + away_y_m * np.sin(heading_rad[nearest])


def _ids(tables: Sequence[tuple[Path, Path]]) -> list[str]:
    """Names of the drives: what their files have in common, or numbers where that is nothing or not one's own."""
    names = []
    for subject_file, objects_file in tables:
        first, second = (TABLE_SUFFIXES.sub("", file.name) for file in (subject_file, objects_file))
        length = next((i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a != b), 0)
        names.append(first[:length].rstrip("_- ."))
    if len(set(names)) == len(names) and all(DRIVE_ID.fullmatch(name) for name in names):
        return names
    return [f"d{number:02d}" for number in range(1, len(tables) + 1)]


def roles_of(num_drives: int) -> list[Role]:
    """Hold out a third of the drives, evenly over them, and one at least where there are two."""
    num_held_out = max(1, round(HELD_OUT_SHARE * num_drives)) if num_drives > 1 else 0
    held_out = {math.ceil((k + 1) * num_drives / num_held_out) - 1 for k in range(num_held_out)}
    return ["held_out" if number in held_out else "fit" for number in range(num_drives)]
