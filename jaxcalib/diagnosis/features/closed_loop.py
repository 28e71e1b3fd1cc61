"""Features of traffic as the subject vehicle meets it: speeds, densities, time gaps, lane shares, lane changes."""

import numpy as np

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.drive_table import DriveTable
from jaxcalib.diagnosis.features.features import Cell, TallyBook

CHANNEL = "closed_loop"
SPEED_BORDERS = (0.35, 0.6, 0.85)  # of the limit
SPEED_NAMES = ("jam", "slow", "dense", "free flow")
GAP_BORDERS_S = (0.8, 1.2, 1.6, 2.2, 3.5)
ENTRY_M = 700.0  # platoons that arrive are still together there
MOST_TIME_GAP_S = 6.0
LEAST_SPEED_MPS = 3.0
WAVE_S = 20.0  # from one look at density to the next, for its fluctuation
DETECTABLE_SLOW_S = 5.0
STANDING_MPS = 0.3
FLOWING_MPS = 3.0


def count_closed_loop(table: DriveTable, road: Conventions, book: TallyBook) -> None:
    """Enter the features of a drive; instants may be 0.5 s apart."""
    background = ~table.is_subject
    lane = road.lane_from_left[table.lane]
    limit = road.limit_at(table.lane, table.position_m)
    stretch = np.digitize(table.position_m, road.stretch_m) - 1
    on_route = (stretch >= 0) & (stretch < len(road.stretch_m) - 1)
    lanes = np.unique(road.lane_from_left)

    _speeds(table, road, book, background & on_route, lane, lanes, limit, stretch)
    _occupancy(table, road, book, background & on_route, lane, lanes, stretch)
    _time_gaps(table, road, book, background, lane, lanes, limit)
    _lane_changes(table, road, book, background, stretch)
    _subject(table, road, book)
    _standing(table, book, background)


def _speeds(table, road, book, chosen, lane, lanes, limit, stretch) -> None:
    speed = table.speed_mps
    ratio = speed / limit
    num_stretches = len(road.stretch_m) - 1
    below = np.bincount(stretch[chosen], minlength=num_stretches)
    above = np.bincount(stretch[chosen], speed[chosen], num_stretches)
    for index in range(num_stretches):
        book.quotient(Cell(CHANNEL, "speed_mps").within(*road.stretch_m[index : index + 2]), above[index], below[index])
    for one in lanes:
        book.mean(Cell(CHANNEL, "speed_mps", lane=int(one)), speed, chosen & (lane == one))
    regime = np.digitize(ratio, SPEED_BORDERS)
    for index, name in enumerate(SPEED_NAMES):
        book.quotient(Cell(CHANNEL, "share", name), (chosen & (regime == index)).sum(), chosen.sum())
    # unhindered vehicles: their speeds are the desired ones
    gap_s = _front_gap_s(table, road)
    free = chosen & (gap_s > 4.0) & (ratio > 0.6)
    book.mean(Cell(CHANNEL, "free_speed_ratio"), ratio, free)
    book.mean(Cell(CHANNEL, "free_speed_variance", is_logarithmic=True), (ratio - 0.97) ** 2, free)
    for name, low, high in (("very slow", 0.0, 0.8), ("slow", 0.8, 0.88), ("fast", 1.05, 9.0)):
        book.quotient(
            Cell(CHANNEL, "free_speed_share", name), (free & (ratio >= low) & (ratio < high)).sum(), free.sum()
        )
    for one in lanes:
        book.mean(Cell(CHANNEL, "free_speed_ratio", lane=int(one)), ratio, free & (lane == one))
    # place and time together
    period = np.digitize(table.time_s[table.instant], road.period_s) - 1
    coarse = stretch // 2
    shape = (int(coarse.max(initial=0)) + 1, len(road.period_s))
    flat = coarse * shape[1] + np.clip(period, 0, shape[1] - 1)
    below = np.bincount(flat[chosen], minlength=shape[0] * shape[1]).reshape(shape)
    above = np.bincount(flat[chosen], speed[chosen], shape[0] * shape[1]).reshape(shape)
    for place, time in zip(*np.nonzero(below), strict=True):
        cell = Cell(
            CHANNEL, "speed_mps", "by time",
            from_m=float(road.stretch_m[2 * place]),
            to_m=float(road.stretch_m[min(2 * place + 2, num_stretches)]),
            from_s=float(road.period_s[time]), to_s=float(road.period_s[time] + np.diff(road.period_s[:2])[0]),
        )  # fmt: skip
        book.quotient(cell, above[place, time], below[place, time])


def _occupancy(table, road, book, chosen, lane, lanes, stretch) -> None:
    num_instants = max(int(table.is_valid.sum()), 1)
    near = chosen & (np.abs(table.offset_m) < min(road.ahead_m, road.behind_m) - 30.0)
    thirds = np.minimum(3 * stretch // (len(road.stretch_m) - 1), 2)
    for one in lanes:
        book.quotient(Cell(CHANNEL, "lane_share", lane=int(one)), (near & (lane == one)).sum(), near.sum())
        for third in range(3):
            at = near & (thirds == third)
            cell = Cell(
                CHANNEL, "lane_share", lane=int(one), from_m=float(road.stretch_m[0] + third * road.stretch_m[-1] / 3),
                to_m=float(road.stretch_m[0] + (third + 1) * road.stretch_m[-1] / 3),
            )  # fmt: skip
            book.quotient(cell, (at & (lane == one)).sum(), at.sum())
    seen = np.bincount(table.instant[near], minlength=len(table.time_s)).astype(float)
    subject_at = np.zeros(len(table.time_s))
    subject_at[table.instant[table.is_subject]] = table.position_m[table.is_subject]
    place = np.digitize(subject_at, road.stretch_m) - 1
    for index in range(len(road.stretch_m) - 1):
        at = table.is_valid & (place == index)
        book.quotient(
            Cell(CHANNEL, "vehicles_near").within(*road.stretch_m[index : index + 2]), seen[at].sum(), at.sum()
        )
    book.quotient(Cell(CHANNEL, "vehicles_near"), seen[table.is_valid].sum(), num_instants)
    # fluctuation of density: what platoons raise
    shift = round(WAVE_S / table.interval_s)
    ahead = np.bincount(table.instant[chosen & (table.offset_m > 0)], minlength=len(table.time_s)).astype(float)
    for name, at in (("", subject_at < np.inf), ("near the entrance", subject_at < ENTRY_M)):
        both = (table.is_valid & at)[shift:] & table.is_valid[:-shift]
        change = (ahead[shift:] - ahead[:-shift]) ** 2
        level = ahead[shift:] + ahead[:-shift]
        book.quotient(
            Cell(CHANNEL, "density_fluctuation", name, is_logarithmic=True), change[both].sum(), level[both].sum()
        )


def _front_gap_s(table: DriveTable, road: Conventions) -> np.ndarray:
    """Return the time gap to the leader; inf where there is none for certain, nan where it may be out of range."""
    leader = table.leader
    has = leader >= 0
    gap_m = np.full(len(leader), np.inf)
    gap_m[has] = table.position_m[leader[has]] - table.position_m[has] - road.nominal_length_m
    speed = np.maximum(table.speed_mps, 0.1)
    seen_m = road.ahead_m - table.offset_m
    return np.where(has, gap_m / speed, np.where(seen_m / speed > MOST_TIME_GAP_S, np.inf, np.nan))


def _time_gaps(table, road, book, background, lane, lanes, limit) -> None:
    gap_s = _front_gap_s(table, road)
    moving = background & (table.speed_mps > LEAST_SPEED_MPS) & ~np.isnan(gap_s)
    ratio = table.speed_mps / limit
    kind = np.digitize(gap_s, GAP_BORDERS_S)
    for name, low, high in (("slow", 0.2, 0.6), ("dense", 0.6, 0.85), ("free flow", 0.85, 9.0)):
        at = moving & (ratio >= low) & (ratio < high)
        for index, border in enumerate(GAP_BORDERS_S):
            cell = Cell(CHANNEL, f"time_gap_share_below_{border:g}_s", name)
            book.quotient(cell, (at & (kind <= index)).sum(), at.sum())
    entry = moving & (table.position_m < ENTRY_M)
    for index, border in enumerate(GAP_BORDERS_S):
        cell = Cell(CHANNEL, f"time_gap_share_below_{border:g}_s", "near the entrance")
        book.quotient(cell, (entry & (kind <= index)).sum(), entry.sum())
    follows = moving & (gap_s < 3.0)
    for one in lanes:
        book.mean(Cell(CHANNEL, "time_gap_s", "following", lane=int(one)), np.nan_to_num(gap_s, posinf=0.0),
                  follows & (lane == one))  # fmt: skip
    steady = follows & (ratio > 0.2)
    gap = np.nan_to_num(gap_s, posinf=0.0)
    book.mean(Cell(CHANNEL, "time_gap_square_s2", is_logarithmic=True), (gap - 1.3) ** 2, steady)
    jam = background & (table.speed_mps < 1.0) & (table.leader >= 0)
    gap_m = np.zeros(len(gap_s))
    has = table.leader >= 0
    gap_m[has] = table.position_m[table.leader[has]] - table.position_m[has] - road.nominal_length_m
    book.mean(Cell(CHANNEL, "standing_gap_m"), gap_m, jam & (gap_m < 15.0))
    book.quotient(
        Cell(CHANNEL, "standing_gap_share_above_8_m"), (jam & (gap_m > 8.0) & (gap_m < 30.0)).sum(), jam.sum()
    )


def _lane_changes(table, road, book, background, stretch) -> None:
    before = table.before
    known = background & (before >= 0)
    lane = road.lane_from_left
    was = lane[table.lane[np.maximum(before, 0)]]
    now = lane[table.lane]
    travelled = np.where(known, table.speed_mps * table.interval_s, 0.0)
    num_stretches = len(road.stretch_m) - 1
    groups = 8 if num_stretches >= 8 else num_stretches
    group = np.clip(stretch * groups // num_stretches, 0, groups - 1)
    km = np.bincount(group, travelled, groups) / 1000.0
    for name, moved in (("left", known & (now < was)), ("right", known & (now > was))):
        count = np.bincount(group[moved], minlength=groups)
        book.quotient(Cell(CHANNEL, "lane_changes_pkm", f"to the {name}"), count.sum(), km.sum())
        for index in range(groups):
            length_m = road.stretch_m[-1] / groups
            cell = Cell(CHANNEL, "lane_changes_pkm", f"to the {name}").within(length_m * index, length_m * (index + 1))
            book.quotient(cell, count[index], km[index])
    changed = known & (now != was)
    leader, follower = table.leader, table.follower
    front = np.where(leader >= 0, table.position_m[np.maximum(leader, 0)] - table.position_m, np.nan)
    rear = np.where(follower >= 0, table.position_m - table.position_m[np.maximum(follower, 0)], np.nan)
    for name, space in (("ahead", front), ("behind", rear)):
        ok = changed & (space < 60.0)
        book.mean(Cell(CHANNEL, f"accepted_gap_{name}_m"), np.nan_to_num(space) - road.nominal_length_m, ok)
        near = ok & (space - road.nominal_length_m < 10.0)
        book.quotient(Cell(CHANNEL, f"accepted_gap_{name}_share_below_10_m"), near.sum(), changed.sum())
    subject_front = changed & (leader >= 0) & (follower >= 0)
    cut_in = subject_front & (table.track[np.maximum(follower, 0)] == -1)
    book.quotient(Cell(CHANNEL, "cut_ins", role="subject"), cut_in.sum(), 1.0)


def _subject(table, road, book) -> None:
    at = table.is_subject
    gap_s = _front_gap_s(table, road)
    book.mean(Cell(CHANNEL, "speed_mps", role="subject"), table.speed_mps, at)
    close = at & (gap_s < 4.0)
    book.mean(Cell(CHANNEL, "time_gap_s", "following", role="subject"), np.nan_to_num(gap_s, posinf=0.0), close)
    acceleration = table.subject_acceleration_mps2[table.instant]
    book.mean(Cell(CHANNEL, "acceleration_square_m2ps4", role="subject", is_logarithmic=True), acceleration**2, at)
    lane = road.lane_from_left[table.lane]
    before = table.before
    moved = at & (before >= 0) & (lane != lane[np.maximum(before, 0)])
    book.quotient(Cell(CHANNEL, "lane_changes", role="subject"), moved.sum(), 1.0)


def _standing(table: DriveTable, book: TallyBook, background: np.ndarray) -> None:
    """Vehicles that stand while those of another lane beside them flow: what a blockage looks like."""
    stands = background & (table.speed_mps < STANDING_MPS)
    flowing = np.zeros(len(table.time_s))
    count = np.zeros(len(table.time_s))
    np.add.at(flowing, table.instant, (table.speed_mps > FLOWING_MPS).astype(float))
    np.add.at(count, table.instant, 1.0)
    leaderless = stands & (
        (table.leader < 0) | (table.position_m[np.maximum(table.leader, 0)] - table.position_m > 25.0)
    )
    alone = leaderless & (flowing[table.instant] > 0.3 * count[table.instant])
    book.quotient(Cell(CHANNEL, "standing_without_leader_share"), alone.sum(), max(int(background.sum()), 1))
