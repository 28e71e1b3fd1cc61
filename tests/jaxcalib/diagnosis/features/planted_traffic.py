"""Drives as tables, made of vehicles whose motion is known, on the road of `tests.jaxcalib.diagnosis.synthetic`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.features import Cell, TallyBook
from surrogate.road.drive_table import DriveTable
from surrogate.road.perception import NO_TRACK

INTERVAL_S = 0.5
SUBJECT = NO_TRACK
LEFT, RIGHT = 1, 0  # rows of the road
LENGTH_M = 4.8


@dataclass(frozen=True)
class Motion:
    """A vehicle, one number per instant."""

    track: int
    row: np.ndarray
    position_m: np.ndarray
    speed_mps: np.ndarray


def steady(track: int, row: int | np.ndarray, start_m: float, speed_mps: float, num_instants: int) -> Motion:
    """Return a vehicle with constant speed."""
    way_m = INTERVAL_S * speed_mps * np.arange(num_instants)
    rows = np.broadcast_to(np.asarray(row), (num_instants,))
    return Motion(track, rows, start_m + way_m, np.full(num_instants, speed_mps))


def table_of(motions: Sequence[Motion]) -> DriveTable:
    """Return the table of a drive; one of the vehicles is the subject vehicle, and all are seen at all times."""
    (subject,) = (one for one in motions if one.track == SUBJECT)
    num = len(subject.position_m)
    instant = np.repeat(np.arange(num), len(motions))
    track = np.tile([one.track for one in motions], num)
    row, position_m, speed_mps = (
        np.stack([getattr(one, name) for one in motions], axis=1).ravel() for name in ("row", "position_m", "speed_mps")
    )
    return DriveTable(
        interval_s=INTERVAL_S,
        time_s=INTERVAL_S * np.arange(num),
        is_valid=np.ones(num, bool),
        subject_acceleration_mps2=np.gradient(subject.speed_mps, INTERVAL_S),
        subject_speed_mps=subject.speed_mps,
        instant=instant,
        track=track,
        lane=row,
        offset_m=position_m - subject.position_m[instant],
        position_m=position_m,
        speed_mps=speed_mps,
        lateral_m=np.zeros(len(row)),
    ).sorted()


def tallies(book: TallyBook, cell: Cell) -> tuple[float, float]:
    """The two tallies of a feature; one that was never entered is an error."""
    (key,) = (other for other in book.sums if _describes_alike(other, cell))
    return book.sums[key]


def value(book: TallyBook, cell: Cell) -> float:
    """Return a feature; what was never observed is an error."""
    above, below = tallies(book, cell)
    assert below > 0.0
    return above / below


def _describes_alike(cell: Cell, other: Cell) -> bool:
    """Whether two cells describe the same, whatever statistics they carry."""
    names = ("channel", "measure", "regime", "role", "lane", "from_m", "to_m", "from_s", "to_s")
    return all(getattr(cell, name) == getattr(other, name) for name in names)
