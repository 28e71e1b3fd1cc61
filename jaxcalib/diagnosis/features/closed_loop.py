"""Features of traffic as the subject vehicle meets it: speeds, densities, time gaps, lane shares, lane changes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.features import EVENT, ROWS_PER_EVENT, Cell, Channel, TallyBook
from surrogate.effects.base import SearchedAt
from surrogate.road.drive_table import DriveTable, RowFlags, RowNumbers, RowValues

CHANNEL = Channel.CLOSED_LOOP
SPEED_BORDERS = (0.35, 0.6, 0.85)  # of the limit
SPEED_NAMES = ("jam", "slow", "dense", "free flow")
GAP_BORDERS_S = (0.8, 1.2, 1.6, 2.2, 3.5)
ENTRY_M = 700.0  # platoons that arrive are still together there
MOST_TIME_GAP_S = 6.0
LEAST_SPEED_MPS = 3.0
WAVE_S = 20.0  # from one look at density to the next, for its fluctuation
STANDING_MPS = 0.3
FLOWING_MPS = 3.0
STANDING_TOLERANCE = 0.001


def count_closed_loop(table: DriveTable, road: Conventions, book: TallyBook) -> None:
    """Enter the features of a drive; instants may be 0.5 s apart."""
    traffic = _traffic_of(table, road)
    _count_speeds(table, road, book, traffic)
    _count_occupancy(table, road, book, traffic)
    _count_time_gaps(table, road, book, traffic)
    _count_lane_changes(table, road, book, traffic)
    _count_subject(table, road, book, traffic)
    _count_standing(table, book, traffic)


@dataclass(frozen=True)
class _Traffic:
    """What several features of a drive ask for."""

    background: RowFlags  # rows of other vehicles than the subject vehicle
    on_route: RowFlags  # those of them on the stretches
    lane: RowNumbers  # lane of each row, counted from the left
    lanes: Int[np.ndarray, " lane"]  # all lanes
    stretch: RowNumbers  # number of the stretch of each row
    limit_ratio: RowValues  # speed over the limit
    gap_m: RowValues  # leader's rear bumper less own front bumper; inf where no leader is in range
    # time gap to the leader; inf where there is none for certain, nan where it may be out of range
    time_gap_s: RowValues


def _traffic_of(table: DriveTable, road: Conventions) -> _Traffic:
    background = ~table.is_subject
    stretch = np.digitize(table.position_m, road.stretch_m) - 1
    is_on_stretch = (stretch >= 0) & (stretch < len(road.stretch_m) - 1)
    gap_m = table.gap_m(road.nominal_length_m)
    speed_mps = np.maximum(table.speed_mps, 0.1)
    is_surely_free = (road.log.ahead_m - table.offset_m) / speed_mps > MOST_TIME_GAP_S
    without_leader = np.where(is_surely_free, np.inf, np.nan)
    return _Traffic(
        background=background,
        on_route=background & is_on_stretch,
        lane=road.lane_from_left[table.lane],
        lanes=np.unique(road.lane_from_left),
        stretch=stretch,
        limit_ratio=table.speed_mps / road.limit_at(table.lane, table.position_m),
        gap_m=gap_m,
        time_gap_s=np.where(table.leader >= 0, gap_m / speed_mps, without_leader),
    )


def _share(measure: str, regime: str = "") -> Cell:
    """The cell of a share of rows."""
    return Cell(CHANNEL, measure, regime, rows_per_event=ROWS_PER_EVENT)


def _count_speeds(table: DriveTable, road: Conventions, book: TallyBook, traffic: _Traffic) -> None:
    speed_mps, ratio, chosen = table.speed_mps, traffic.limit_ratio, traffic.on_route
    num_stretches = len(road.stretch_m) - 1
    below = np.bincount(traffic.stretch[chosen], minlength=num_stretches)
    above = np.bincount(traffic.stretch[chosen], speed_mps[chosen], num_stretches)
    for index in range(num_stretches):
        book.quotient(Cell(CHANNEL, "speed_mps").within(*road.stretch_m[index : index + 2]), above[index], below[index])
    for lane in traffic.lanes:
        book.mean(Cell(CHANNEL, "speed_mps", lane=int(lane)), speed_mps, chosen & (traffic.lane == lane))
    regime = np.digitize(ratio, SPEED_BORDERS)
    for index, name in enumerate(SPEED_NAMES):
        book.quotient(_share("share", name), (chosen & (regime == index)).sum(), chosen.sum())
    # unhindered vehicles: their speeds are the desired ones
    free = chosen & (traffic.time_gap_s > 4.0) & (ratio > 0.6)
    book.mean(Cell(CHANNEL, "free_speed_ratio"), ratio, free)
    book.mean(Cell(CHANNEL, "free_speed_variance", is_logarithmic=True), (ratio - 0.97) ** 2, free)
    for name, low, high in (("very slow", 0.0, 0.8), ("slow", 0.8, 0.88), ("fast", 1.05, 9.0)):
        book.quotient(_share("free_speed_share", name), (free & (ratio >= low) & (ratio < high)).sum(), free.sum())
    for lane in traffic.lanes:
        book.mean(Cell(CHANNEL, "free_speed_ratio", lane=int(lane)), ratio, free & (traffic.lane == lane))
    _count_speeds_by_time(table, road, book, traffic)


def _count_speeds_by_time(table: DriveTable, road: Conventions, book: TallyBook, traffic: _Traffic) -> None:
    """Speeds by stretch and period together; two stretches make one here."""
    chosen = traffic.on_route
    period = np.digitize(table.time_s[table.instant], road.period_s) - 1
    pair = traffic.stretch // 2
    shape = (int(pair.max(initial=0)) + 1, len(road.period_s))
    flat = pair * shape[1] + np.clip(period, 0, shape[1] - 1)
    below = np.bincount(flat[chosen], minlength=shape[0] * shape[1]).reshape(shape)
    above = np.bincount(flat[chosen], table.speed_mps[chosen], shape[0] * shape[1]).reshape(shape)
    last = len(road.stretch_m) - 1
    for index, time in zip(*np.nonzero(below), strict=True):
        cell = Cell(
            CHANNEL, "speed_mps", "by time",
            from_m=float(road.stretch_m[2 * index]), to_m=float(road.stretch_m[min(2 * index + 2, last)]),
            from_s=float(road.period_s[time]), to_s=float(road.period_s[time] + np.diff(road.period_s[:2])[0]),
            locates=SearchedAt.SPELLS,
        )  # fmt: skip
        book.quotient(cell, float(above[index, time]), float(below[index, time]))


def _count_occupancy(table: DriveTable, road: Conventions, book: TallyBook, traffic: _Traffic) -> None:
    num_instants = max(int(table.is_valid.sum()), 1)
    near = traffic.on_route & (np.abs(table.offset_m) < min(road.log.ahead_m, road.log.behind_m) - 30.0)
    thirds = np.minimum(3 * traffic.stretch // (len(road.stretch_m) - 1), 2)
    for lane in traffic.lanes:
        in_lane = traffic.lane == lane
        share = _share("lane_share")._replace(lane=int(lane))
        book.quotient(share, (near & in_lane).sum(), near.sum())
        for third in range(3):
            at = near & (thirds == third)
            begin_m, end_m = (float(road.stretch_m[0] + k * road.stretch_m[-1] / 3) for k in (third, third + 1))
            book.quotient(share.within(begin_m, end_m), (at & in_lane).sum(), at.sum())
    seen = np.bincount(table.instant[near], minlength=len(table.time_s)).astype(float)
    subject_m = np.zeros(len(table.time_s))
    subject_m[table.instant[table.is_subject]] = table.position_m[table.is_subject]
    subject_stretch = np.digitize(subject_m, road.stretch_m) - 1
    for index in range(len(road.stretch_m) - 1):
        at = table.is_valid & (subject_stretch == index)
        book.quotient(
            Cell(CHANNEL, "vehicles_near").within(*road.stretch_m[index : index + 2]), seen[at].sum(), at.sum()
        )
    book.quotient(Cell(CHANNEL, "vehicles_near"), seen[table.is_valid].sum(), num_instants)
    # fluctuation of density: what platoons raise
    shift = round(WAVE_S / table.interval_s)
    is_ahead = traffic.on_route & (table.offset_m > 0)
    ahead = np.bincount(table.instant[is_ahead], minlength=len(table.time_s)).astype(float)
    for name, at in (("", subject_m < np.inf), ("near the entrance", subject_m < ENTRY_M)):
        both = (table.is_valid & at)[shift:] & table.is_valid[:-shift]
        change = (ahead[shift:] - ahead[:-shift]) ** 2
        level = ahead[shift:] + ahead[:-shift]
        book.quotient(
            Cell(CHANNEL, "density_fluctuation", name, is_logarithmic=True), change[both].sum(), level[both].sum()
        )


def _count_time_gaps(table: DriveTable, road: Conventions, book: TallyBook, traffic: _Traffic) -> None:
    gap_s, ratio, gap_m = traffic.time_gap_s, traffic.limit_ratio, traffic.gap_m
    moving = traffic.background & (table.speed_mps > LEAST_SPEED_MPS) & ~np.isnan(gap_s)
    kind = np.digitize(gap_s, GAP_BORDERS_S)
    for name, low, high in (("slow", 0.2, 0.6), ("dense", 0.6, 0.85), ("free flow", 0.85, 9.0)):
        at = moving & (ratio >= low) & (ratio < high)
        for index, border in enumerate(GAP_BORDERS_S):
            book.quotient(_share(f"time_gap_share_below_{border:g}_s", name), (at & (kind <= index)).sum(), at.sum())
    entry = moving & (table.position_m < ENTRY_M)
    for index, border in enumerate(GAP_BORDERS_S):
        share = _share(f"time_gap_share_below_{border:g}_s", "near the entrance")
        book.quotient(share, (entry & (kind <= index)).sum(), entry.sum())
    follows = moving & (gap_s < 3.0)
    for lane in traffic.lanes:
        cell = Cell(CHANNEL, "time_gap_s", "following", lane=int(lane))
        book.mean(cell, gap_s, follows & (traffic.lane == lane))
    cell = Cell(CHANNEL, "time_gap_square_s2", is_logarithmic=True)
    finite_s = np.nan_to_num(gap_s, posinf=0.0)
    book.mean(cell, (finite_s - 1.3) ** 2, follows & (ratio > 0.2))
    jam = traffic.background & (table.speed_mps < 1.0) & (table.leader >= 0)
    book.mean(Cell(CHANNEL, "standing_gap_m"), gap_m, jam & (gap_m < 15.0))
    book.quotient(_share("standing_gap_share_above_8_m"), (jam & (gap_m > 8.0) & (gap_m < 30.0)).sum(), jam.sum())


def _count_lane_changes(table: DriveTable, road: Conventions, book: TallyBook, traffic: _Traffic) -> None:
    before = table.before
    known = traffic.background & (before >= 0)
    was = road.lane_from_left[table.lane[np.maximum(before, 0)]]
    now = traffic.lane
    travelled_m = np.where(known, table.speed_mps * table.interval_s, 0.0)
    num_stretches = len(road.stretch_m) - 1
    groups = 8 if num_stretches >= 8 else num_stretches
    group = np.clip(traffic.stretch * groups // num_stretches, 0, groups - 1)
    km = np.bincount(group, travelled_m, groups) / 1000.0
    for name, moved in (("left", known & (now < was)), ("right", known & (now > was))):
        count = np.bincount(group[moved], minlength=groups)
        cell = Cell(CHANNEL, "lane_changes_pkm", f"to the {name}", rows_per_event=EVENT)
        book.quotient(cell, count.sum(), km.sum())
        for index in range(groups):
            length_m = road.stretch_m[-1] / groups
            book.quotient(cell.within(length_m * index, length_m * (index + 1)), count[index], km[index])
    changed = known & (now != was)
    leader, follower = table.leader, table.follower
    behind_m = np.where(follower >= 0, table.spacing_m[np.maximum(follower, 0)], np.inf)
    for name, spacing_m in (("ahead", table.spacing_m), ("behind", behind_m)):
        gap_m = spacing_m - road.nominal_length_m
        ok = changed & (spacing_m < 60.0)
        book.mean(Cell(CHANNEL, f"accepted_gap_{name}_m"), gap_m, ok)
        book.quotient(_share(f"accepted_gap_{name}_share_below_10_m"), (ok & (gap_m < 10.0)).sum(), changed.sum())
    between = changed & (leader >= 0) & (follower >= 0)
    cut_in = between & table.is_subject[np.maximum(follower, 0)]
    book.quotient(Cell(CHANNEL, "cut_ins", role="subject", rows_per_event=EVENT), cut_in.sum(), 1.0)


def _count_subject(table: DriveTable, road: Conventions, book: TallyBook, traffic: _Traffic) -> None:
    at = table.is_subject
    book.mean(Cell(CHANNEL, "speed_mps", role="subject"), table.speed_mps, at)
    close = at & (traffic.time_gap_s < 4.0)
    book.mean(Cell(CHANNEL, "time_gap_s", "following", role="subject"), traffic.time_gap_s, close)
    acceleration = table.subject_acceleration_mps2[table.instant]
    book.mean(Cell(CHANNEL, "acceleration_square_m2ps4", role="subject", is_logarithmic=True), acceleration**2, at)
    before = table.before
    moved = at & (before >= 0) & (traffic.lane != traffic.lane[np.maximum(before, 0)])
    book.quotient(Cell(CHANNEL, "lane_changes", role="subject", rows_per_event=EVENT), moved.sum(), 1.0)


def _count_standing(table: DriveTable, book: TallyBook, traffic: _Traffic) -> None:
    """Vehicles that stand while those of another lane beside them flow: what a blockage looks like."""
    stands = traffic.background & (table.speed_mps < STANDING_MPS)
    flowing, present = np.zeros((2, len(table.time_s)))
    np.add.at(flowing, table.instant, (table.speed_mps > FLOWING_MPS).astype(float))
    np.add.at(present, table.instant, 1.0)
    alone = stands & (table.spacing_m > 25.0) & (flowing[table.instant] > 0.3 * present[table.instant])
    cell = _share("standing_without_leader_share")._replace(tolerance=STANDING_TOLERANCE)
    book.quotient(cell, alone.sum(), max(int(traffic.background.sum()), 1))
