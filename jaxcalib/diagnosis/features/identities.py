"""Features that no driver model enters: what motion and sensors must satisfy whoever drives.

The change of a distance is the integral of the speed difference; an acceleration is the change of a speed; a vehicle is
lost where the sensor ends and nowhere else; a lane change takes as long as the lateral position moves; a driver who
acts at every step changes acceleration at every step.
"""

import numpy as np

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.features import EVENT, ROWS_PER_EVENT, Cell, Channel, TallyBook
from surrogate.effects.base import Reading
from surrogate.road.drive_table import DriveTable, RowFlags, RowNumbers, RowValues

CHANNEL = Channel.IDENTITY
WINDOW_S = 1.0
EDGE_M = 25.0  # beside the end of the range, where vehicles come and go
RING_BORDERS = (0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97)  # of the range
OFF_CENTRE_M = 0.3
HELD_MPS2 = 0.06
ACTING_MPS2 = 0.15
RHYTHM_STEPS = 15
SUBJECT_HELD_MPS2 = 2e-3  # its acceleration is logged, not taken from speeds
# What identities leave open: logs are rounded, integrators differ by half a step, and no simulator has the fine
# structure of real accelerations. In each feature's own unit; logarithmic features in natural logarithms.
DISTANCE_SCALE_TOLERANCE, LATENCY_TOLERANCE_S, DISTANCE_ERROR_TOLERANCE = 0.003, 0.05, 1.5
SECOND_DIFFERENCE_TOLERANCE, ALTERNATION_TOLERANCE = 0.7, 0.3
HELD_TOLERANCE, JUMP_TOLERANCE, STEP_TOLERANCE, RHYTHM_TOLERANCE = 0.2, 0.06, 0.8, 0.06
OFF_CENTRE_TOLERANCE_S, TRACK_TOLERANCE, RING_TOLERANCE, SPEED_CHANGE_TOLERANCE_MPS2 = 0.3, 0.3, 0.01, 0.02


def count_identities(table: DriveTable, road: Conventions, book: TallyBook) -> None:
    """Enter the features of a drive at the sampling of the log."""
    objects = ~table.is_subject
    _count_motion(table, book, objects)
    _count_noise(table, book, objects)
    _count_range(table, road, book, objects)
    _count_lateral(table, book)
    _count_acting(table, book, objects)
    _count_subject(table, book)


def _count_motion(table: DriveTable, book: TallyBook, objects: RowFlags) -> None:
    """Distance against speed difference over a window: its slope is the sensor's scale, its lag the latency."""
    steps = max(1, round(WINDOW_S / table.interval_s))
    now = np.flatnonzero(objects)
    path = [now]
    for _ in range(steps):
        path.append(np.where(path[-1] >= 0, table.after[path[-1]], -1))
    whole = path[-1] >= 0
    rows = [row[whole] for row in path]
    if not whole.any():
        return
    own = table.subject_speed_mps
    difference = [table.speed_mps[row] - own[table.instant[row]] for row in rows]
    expected = table.interval_s * (0.5 * difference[0] + sum(difference[1:-1]) + 0.5 * difference[-1])
    observed = table.offset_m[rows[-1]] - table.offset_m[rows[0]]
    error = observed - expected
    mine = own[table.instant[rows[-1]]] - own[table.instant[rows[0]]]
    theirs = table.speed_mps[rows[-1]] - table.speed_mps[rows[0]]
    usual = np.abs(error) < 5.0
    error, expected, mine, theirs = error[usual], expected[usual], mine[usual], theirs[usual]
    cell = Cell(CHANNEL, "distance_scale_error", tolerance=DISTANCE_SCALE_TOLERANCE, reads=Reading.DISTANCE_SCALE)
    book.quotient(cell, (error * expected).sum(), (expected**2).sum())
    cell = Cell(
        CHANNEL, "latency_by_own_change_s", role="subject", tolerance=LATENCY_TOLERANCE_S, reads=Reading.LATENCY
    )
    book.quotient(cell, (error * mine).sum(), (mine**2).sum())
    cell = Cell(CHANNEL, "latency_by_their_change_s", tolerance=LATENCY_TOLERANCE_S, reads=Reading.LATENCY)
    book.quotient(cell, (error * theirs).sum(), (theirs**2).sum())
    cell = Cell(CHANNEL, "distance_error_square_m2", is_logarithmic=True, tolerance=DISTANCE_ERROR_TOLERANCE)
    book.quotient(cell, (error**2).sum() + 1e-6 * len(error), len(error))


def _count_noise(table: DriveTable, book: TallyBook, objects: RowFlags) -> None:
    """Second differences: white noise has them at every step and against the one before."""
    before, after = np.maximum(table.before, 0), np.maximum(table.after, 0)
    inner = objects & (table.before >= 0) & (table.after >= 0)
    inner &= (table.lane[before] == table.lane) & (table.lane[after] == table.lane)
    for name, values, most in (("distance_m", table.offset_m, 3.0), ("speed_mps", table.speed_mps, 3.0)):
        second = np.zeros(len(values))
        second[inner] = values[after[inner]] - 2.0 * values[inner] + values[before[inner]]
        usual = inner & (np.abs(second) < most)
        cell = Cell(
            CHANNEL, f"second_difference_square_of_{name}", is_logarithmic=True, tolerance=SECOND_DIFFERENCE_TOLERANCE
        )
        book.quotient(cell, (second[usual] ** 2).sum() + 1e-7 * usual.sum(), usual.sum())
        both = usual & usual[after]
        book.quotient(
            Cell(CHANNEL, f"second_difference_alternation_of_{name}", tolerance=ALTERNATION_TOLERANCE),
            (second * second[after])[both].sum(), (second**2)[usual].sum() + 1e-7 * usual.sum(),
        )  # fmt: skip


def _count_range(table: DriveTable, road: Conventions, book: TallyBook, objects: RowFlags) -> None:
    for name, reach_m, ahead in (("ahead", road.log.ahead_m, True), ("behind", road.log.behind_m, False)):
        side = objects & ((table.offset_m > 0) == ahead)
        share = np.abs(table.offset_m) / reach_m
        for border in RING_BORDERS:
            cell = Cell(
                CHANNEL, f"share_within_{border:.0%}_of_range", name, tolerance=RING_TOLERANCE,
                rows_per_event=ROWS_PER_EVENT,
            )  # fmt: skip
            book.quotient(cell, (side & (share < border)).sum(), side.sum())
    last = objects & (table.after < 0) & (table.instant < len(table.time_s) - 1)
    first = objects & (table.before < 0) & (table.instant > 0)
    rear = np.where(table.offset_m > 0, road.log.ahead_m, road.log.behind_m) - np.abs(table.offset_m)
    inside = rear > EDGE_M
    for begin_m, end_m in road.merge_m:  # vehicles come from ramps and leave by them
        inside &= (table.position_m < begin_m - EDGE_M) | (table.position_m > end_m + EDGE_M)
    inside &= table.position_m < road.stretch_m[-1] - EDGE_M  # at the route's end they arrive
    hundreds_of_s = table.interval_s * (objects & inside).sum() / 100.0
    for name, ends in (("lost", last), ("found", first)):
        cell = Cell(CHANNEL, f"{name}_inside_range_phs", tolerance=TRACK_TOLERANCE, rows_per_event=EVENT)
        book.quotient(cell, (ends & inside).sum(), hundreds_of_s)


def _count_lateral(table: DriveTable, book: TallyBook) -> None:
    off = np.abs(table.lateral_m) > OFF_CENTRE_M
    changed = (table.before >= 0) & (table.lane[np.maximum(table.before, 0)] != table.lane)
    for role, chosen in (("background", ~table.is_subject), ("subject", table.is_subject)):
        cell = Cell(CHANNEL, "time_off_centre_per_lane_change_s", role=role, tolerance=OFF_CENTRE_TOLERANCE_S)
        book.quotient(cell, table.interval_s * (off & chosen).sum(), max((changed & chosen).sum(), 1))


def _count_acting(table: DriveTable, book: TallyBook, objects: RowFlags) -> None:
    """Accelerations that are held for some steps and then jump: drivers who act at intervals."""
    before, after = np.maximum(table.before, 0), np.maximum(table.after, 0)
    step = table.interval_s
    inner = objects & (table.before >= 0) & (table.after >= 0)
    change_before = (table.speed_mps - table.speed_mps[before]) / step
    change_after = (table.speed_mps[after] - table.speed_mps) / step
    moving = inner & (table.speed_mps > 2.0) & (np.abs(change_before) < 4.0) & (np.abs(change_after) < 4.0)
    jerk = np.abs(change_after - change_before)
    active = moving & (np.abs(change_before) > ACTING_MPS2)
    cell = Cell(CHANNEL, "held_acceleration_share", tolerance=HELD_TOLERANCE, rows_per_event=ROWS_PER_EVENT)
    book.quotient(cell, (active & (jerk < HELD_MPS2)).sum(), active.sum())
    for border in (0.3, 0.6):
        cell = _jumps(border, "background")
        book.quotient(cell, (moving & (jerk > border)).sum(), moving.sum())
    cell = Cell(CHANNEL, "acceleration_step_square_m2ps4", is_logarithmic=True, tolerance=STEP_TOLERANCE)
    book.quotient(cell, (jerk[moving] ** 2).sum() + 1e-6 * moving.sum(), moving.sum())
    order = table.by_track
    jump = np.where(moving, np.maximum(jerk - HELD_MPS2, 0.0), 0.0)[order]
    unbroken = np.cumsum((np.diff(table.track[order], prepend=-9) != 0) | ~moving[order])
    _count_rhythm(book, jump, unbroken, step, "background")


def _jumps(border_mps2: float, role: str) -> Cell:
    """The cell of the share of moments at which acceleration jumps."""
    measure = f"acceleration_jumps_above_{border_mps2:g}_mps2_share"
    return Cell(CHANNEL, measure, role=role, tolerance=JUMP_TOLERANCE, rows_per_event=ROWS_PER_EVENT)


def _count_rhythm(book: TallyBook, jump: RowValues, unbroken: RowNumbers, step_s: float, role: str) -> None:
    """Enter how much likelier a jump of acceleration is some steps after another than a step earlier or later."""
    square = (jump**2).sum() + 1e-9
    product = [
        (jump[lag:] * jump[:-lag])[unbroken[lag:] == unbroken[:-lag]].sum() if lag < len(jump) else 0.0
        for lag in range(1, RHYTHM_STEPS + 2)
    ]
    for lag in range(2, RHYTHM_STEPS + 1):
        contrast = product[lag - 1] - 0.5 * (product[lag - 2] + product[lag])
        cell = Cell(CHANNEL, "rhythm_of_acting", f"{lag * step_s:.1f} s", role=role, tolerance=RHYTHM_TOLERANCE)
        book.quotient(cell, contrast, square)


def _count_subject(table: DriveTable, book: TallyBook) -> None:
    """The subject vehicle's own acceleration: held or changed at every step, and whether it is its change of speed."""
    acceleration, speed = table.subject_acceleration_mps2, table.subject_speed_mps
    valid = table.is_valid[1:] & table.is_valid[:-1]
    jerk = np.abs(np.diff(acceleration))
    moving = valid & (speed[1:] > 1.0)
    active = moving & (np.abs(acceleration[1:]) > 0.02)
    cell = Cell(
        CHANNEL, "held_acceleration_share", role="subject", tolerance=HELD_TOLERANCE, rows_per_event=ROWS_PER_EVENT
    )
    book.quotient(cell, (active & (jerk < SUBJECT_HELD_MPS2)).sum(), active.sum())
    for border in (0.05, 0.15):
        cell = _jumps(border, "subject")
        book.quotient(cell, (moving & (jerk > border)).sum(), moving.sum())
    book.quotient(
        Cell(CHANNEL, "acceleration_step_square_m2ps4", role="subject", is_logarithmic=True, tolerance=STEP_TOLERANCE),
        (jerk[moving] ** 2).sum() + 1e-6, max(int(moving.sum()), 1),
    )  # fmt: skip
    jump = np.where(moving, np.maximum(jerk - SUBJECT_HELD_MPS2, 0.0), 0.0)
    _count_rhythm(book, np.minimum(jump, 1.0), np.cumsum(~moving), table.interval_s, "subject")
    error = (acceleration[1:] - np.diff(speed) / table.interval_s)[moving]
    error = error[np.abs(error) < 2.0]
    cell = Cell(CHANNEL, "acceleration_less_speed_change_mps2", role="subject", tolerance=SPEED_CHANGE_TOLERANCE_MPS2)
    book.quotient(cell, error.sum(), len(error))
