"""Features of open-loop replay: what drivers do beyond what the calibrated model does with the same leader.

Each moment at which a vehicle keeps its lane and leader gives a residual: the acceleration over the next interval less
the one that the calibrated model takes from what it meets at both ends. No trajectory is simulated, so that errors do
not pile up, and nothing but the driver's own law is judged.
"""

import itertools

import numpy as np

from jaxcalib.diagnosis.features.closed_loop import SPEED_BORDERS, SPEED_NAMES
from jaxcalib.diagnosis.features.conventions import Conventions, ExpectedDrivers
from jaxcalib.diagnosis.features.drive_table import DriveTable
from jaxcalib.diagnosis.features.features import Cell, TallyBook

CHANNEL = "replay"
MOST_RESIDUAL_MPS2 = 3.0
QUIET_S = 2.0  # since the last change of own lane or leader
CHANGE_BORDERS_S = (0.0, 2.0, 4.0, 8.0, 14.0, 25.0)
FOLLOWING_S = 3.5
LAGS_S = (0.5, 1.0, 1.5, 2.0, 3.0)
RECENT_S = 60.0
SLOW_MPS = 8.0
RECOVERY_S = 20.0
LEAST_SAMPLES = 8


def count_replay(
    table: DriveTable, road: Conventions, background: ExpectedDrivers, subject: ExpectedDrivers, book: TallyBook
) -> None:
    """Enter the features of a drive; instants should be 0.5 s apart."""
    step = table.interval_s
    leader, after = table.leader, table.after
    has_after = after >= 0
    later = np.maximum(after, 0)
    same_lane = has_after & (table.lane[later] == table.lane)
    leader_after = np.where(has_after, leader[later], -2)
    leader_track = np.where(leader >= 0, table.track[np.maximum(leader, 0)], -9)
    later_track = np.where(leader_after >= 0, table.track[np.maximum(leader_after, 0)], -9)
    keeps = same_lane & (leader_track == later_track) & ((leader >= 0) == (leader_after >= 0))

    gap_m = np.full(len(leader), np.inf)
    has = leader >= 0
    gap_m[has] = table.position_m[leader[has]] - table.position_m[has] - road.nominal_length_m
    leader_speed = np.where(has, table.speed_mps[np.maximum(leader, 0)], 0.0)
    limit = road.limit_at(table.lane, table.position_m)
    factor = np.where(table.is_subject, subject.speed_factor, background.speed_factor)
    desired = factor * limit
    mine = table.is_subject
    expected = background.acceleration(table.speed_mps, gap_m, leader_speed, desired)
    own = subject.acceleration(table.speed_mps[mine], gap_m[mine], leader_speed[mine], desired[mine])
    expected[mine] = own
    observed = np.where(has_after, (table.speed_mps[later] - table.speed_mps) / step, 0.0)
    residual = observed - 0.5 * (expected + expected[later])
    residual = np.clip(residual, -MOST_RESIDUAL_MPS2, MOST_RESIDUAL_MPS2)
    change = (table.speed_mps[np.maximum(leader_after, 0)] - leader_speed) / step
    leader_acceleration = np.where(has & (leader_after >= 0), change, 0.0)

    before = np.maximum(table.before, 0)
    has_before = table.before >= 0
    own_change = has_before & (table.lane[before] != table.lane)
    before_leader = np.where(has_before & (leader[before] >= 0), table.track[np.maximum(leader[before], 0)], -9)
    new_leader = has_before & has & (leader_track != before_leader) & ~own_change
    closer = new_leader & (gap_m < np.where(has_before, gap_m[before], np.inf) - 3.0)
    since_own, since_cut_in = table.since(own_change), table.since(closer)
    quiet = (since_own > QUIET_S) & (table.since(new_leader) > QUIET_S)
    time_gap = gap_m / np.maximum(table.speed_mps, 1.0)
    follows = has & (time_gap < FOLLOWING_S)
    seen_m = road.ahead_m - table.offset_m
    is_free = ~has & (seen_m > 4.0 * table.speed_mps)

    people = keeps & ~table.is_subject
    steady = people & quiet & follows
    free = people & quiet & is_free
    ratio = table.speed_mps / limit
    _by_regime(book, residual, ratio, steady, free)
    _by_place(table, road, book, residual, people & quiet & (follows | is_free), ratio)
    _by_history(table, book, residual, ratio, steady, limit)
    _after_changes(book, residual, time_gap, people & has, since_own, since_cut_in)
    _in_time(table, book, residual, expected, observed, leader_acceleration, leader, steady)
    _between(table, book, residual, gap_m, ratio, steady, leader_track)
    _merging(table, road, book, residual, people & quiet, follows)
    at_subject = keeps & mine & quiet & (has | is_free)
    book.mean(Cell(CHANNEL, "residual_mps2", role="subject"), residual, at_subject)
    book.mean(Cell(CHANNEL, "residual_square_m2ps4", role="subject", is_logarithmic=True), residual**2, at_subject)


def _by_regime(book, residual, ratio, steady, free) -> None:
    regime = np.digitize(ratio, SPEED_BORDERS)
    for index, name in enumerate(SPEED_NAMES):
        at = steady & (regime == index)
        book.mean(Cell(CHANNEL, "residual_mps2", f"following, {name}"), residual, at)
        cell = Cell(CHANNEL, "residual_square_m2ps4", f"following, {name}", is_logarithmic=True)
        book.mean(cell, residual**2, at)
    for index in (1, 2, 3):
        at = free & (regime == index)
        book.mean(Cell(CHANNEL, "residual_mps2", f"free, {SPEED_NAMES[index]}"), residual, at)
    book.mean(Cell(CHANNEL, "residual_square_m2ps4", "free", is_logarithmic=True), residual**2, free)


def _by_place(table, road, book, residual, chosen, ratio) -> None:
    number = len(road.stretch_m) - 1
    stretch = np.digitize(table.position_m, road.stretch_m) - 1
    for regime, at in (("slow", ratio < 0.7), ("fast", ratio >= 0.7)):
        now = chosen & at & (stretch >= 0) & (stretch < number)
        above = np.bincount(stretch[now], residual[now], number)
        below = np.bincount(stretch[now], minlength=number)
        for index in range(number):
            cell = Cell(
                CHANNEL,
                "residual_mps2",
                regime,
                from_m=float(road.stretch_m[index]),
                to_m=float(road.stretch_m[index + 1]),
            )
            book.quotient(cell, above[index], below[index])


def _by_history(table, book, residual, ratio, steady, limit) -> None:
    recent = table.recent_mean(table.speed_mps / limit, RECENT_S)
    seen_s = table.since(table.before < 0)
    for name, low, high in (("slow", 0.2, 0.5), ("dense", 0.5, 0.75)):
        at = steady & (ratio >= low) & (ratio < high) & (seen_s > 15.0)
        book.mean(Cell(CHANNEL, "residual_mps2", f"{name}, after slow traffic"), residual, at & (recent < 0.5))
        book.mean(Cell(CHANNEL, "residual_mps2", f"{name}, after fast traffic"), residual, at & (recent >= 0.5))
    since_slow = table.since(table.speed_mps < SLOW_MPS)
    recovering = (since_slow > 0.0) & (since_slow < RECOVERY_S)
    for name, low, high in (("8 to 11 m/s", 8.0, 11.0), ("11 to 14 m/s", 11.0, 14.0), ("14 to 17 m/s", 14.0, 17.0)):
        at = steady & (table.speed_mps >= low) & (table.speed_mps < high)
        book.mean(Cell(CHANNEL, "residual_mps2", f"{name}, recovering"), residual, at & recovering)
        book.mean(Cell(CHANNEL, "residual_mps2", f"{name}, not recovering"), residual, at & ~recovering)
    slow = steady & (table.speed_mps < SLOW_MPS) & (table.speed_mps > 1.0)
    book.mean(
        Cell(CHANNEL, "residual_mps2", "below 8 m/s, starting"),
        residual,
        slow & (residual + ratio > -9) & recovering_start(table),
    )
    book.mean(Cell(CHANNEL, "residual_mps2", "below 8 m/s, not starting"), residual, slow & ~recovering_start(table))


def recovering_start(table: DriveTable) -> np.ndarray:
    """Return where a vehicle's leader is faster than itself by more than 0.5 m/s."""
    leader = table.leader
    return (leader >= 0) & (table.speed_mps[np.maximum(leader, 0)] > table.speed_mps + 0.5)


def _after_changes(book, residual, time_gap, chosen, since_own, since_cut_in) -> None:
    for who, since in (("after own lane change", since_own), ("behind a newcomer", since_cut_in)):
        for low, high in itertools.pairwise(CHANGE_BORDERS_S):
            at = chosen & (since >= low) & (since < high) & (time_gap < FOLLOWING_S)
            regime = f"{who}, {low:g} to {high:g} s"
            book.mean(Cell(CHANNEL, "residual_mps2", regime), residual, at)
            book.mean(Cell(CHANNEL, "time_gap_s", regime), time_gap, at)


def _in_time(table, book, residual, expected, observed, leader_acceleration, leader, steady) -> None:
    for lag_s in LAGS_S:
        steps = round(lag_s / table.interval_s)
        other = table.later(-steps)
        both = steady & (other >= 0)
        both &= steady[np.maximum(other, 0)]
        back = np.maximum(other, 0)
        book.mean(Cell(CHANNEL, "residual_autocovariance_m2ps4", f"{lag_s:g} s"), residual * residual[back], both)
        book.mean(
            Cell(CHANNEL, "residual_with_leader_acceleration_m2ps4", f"{lag_s:g} s"),
            residual * leader_acceleration[back], both,
        )  # fmt: skip
        change = expected - expected[back]
        book.mean(Cell(CHANNEL, "residual_with_expected_change_m2ps4", f"{lag_s:g} s"), residual * change, both)
    book.mean(Cell(CHANNEL, "residual_with_leader_acceleration_m2ps4", "0 s"), residual * leader_acceleration, steady)
    second = np.where(leader >= 0, leader[np.maximum(leader, 0)], -1)
    ahead = steady & (second >= 0)
    difference = table.speed_mps[np.maximum(second, 0)] - table.speed_mps[np.maximum(leader, 0)]
    book.mean(Cell(CHANNEL, "residual_with_second_leader_m2ps3"), residual * np.clip(difference, -5, 5), ahead)
    approach = np.where(leader >= 0, table.speed_mps[np.maximum(leader, 0)] - table.speed_mps, 0.0)
    book.mean(Cell(CHANNEL, "residual_with_approach_m2ps3"), residual * np.clip(approach, -5, 5), steady)
    book.mean(Cell(CHANNEL, "residual_with_expected_m2ps4"), residual * np.clip(expected, -3, 3), steady)
    book.mean(Cell(CHANNEL, "acceleration_square_m2ps4", is_logarithmic=True), observed**2, steady)


def _between(table, book, residual, gap_m, ratio, steady, leader_track) -> None:
    """Between-vehicle spread: the product of two halves' means is free of what varies within a vehicle."""
    at = steady & (ratio > 0.15)
    for name, who in (("drivers", table.track), ("leaders", leader_track)):
        chosen = np.flatnonzero(at)
        order = chosen[np.lexsort((table.instant[chosen], who[chosen]))]
        if not len(order):
            continue
        vehicle, first, count = np.unique(who[order], return_index=True, return_counts=True)
        del vehicle
        enough = count >= LEAST_SAMPLES
        total = np.concatenate([[0.0], np.cumsum(residual[order])])
        half = count // 2
        one = (total[first + half] - total[first]) / np.maximum(half, 1)
        two = (total[first + count] - total[first + half]) / np.maximum(count - half, 1)
        cell = Cell(CHANNEL, "residual_between_vehicles_m2ps4", f"by {name}")
        book.quotient(cell, (one * two)[enough].sum(), enough.sum())
        cube = Cell(CHANNEL, "residual_low_share", f"by {name}")
        book.quotient(cube, (enough & (0.5 * (one + two) < -0.3)).sum(), enough.sum())
    follower_pairs(table, book, residual, at, leader_track)
    for low in (-0.8, -0.4, 0.4, 0.8):
        beyond = residual < low if low < 0 else residual > low
        cell = Cell(CHANNEL, f"residual_share_{'below' if low < 0 else 'above'}_{low:g}_mps2")
        book.quotient(cell, (at & beyond).sum(), at.sum())


def follower_pairs(table: DriveTable, book: TallyBook, residual, at, leader_track) -> None:
    """Enter how alike different followers of one leader are: what a vehicle's length does to all who follow it."""
    chosen = np.flatnonzero(at)
    if not len(chosen):
        return
    pair = leader_track[chosen].astype(np.int64) * 100_000 + table.track[chosen]
    unique, inverse, count = np.unique(pair, return_inverse=True, return_counts=True)
    mean = np.bincount(inverse, residual[chosen]) / count
    enough = count >= LEAST_SAMPLES
    leader, mean = unique[enough] // 100_000, mean[enough]
    _, group, size = np.unique(leader, return_inverse=True, return_counts=True)
    total, square = np.bincount(group, mean), np.bincount(group, mean**2)
    products, pairs = 0.5 * (total**2 - square), 0.5 * size * (size - 1.0)
    book.quotient(Cell(CHANNEL, "residual_alike_behind_one_leader_m2ps4"), products.sum(), pairs.sum())


def _merging(table, road, book, residual, chosen, follows) -> None:
    for begin_m, end_m in road.merge_m:
        lane = road.lane_from_left[table.lane]
        near = chosen & (table.position_m > begin_m - 200.0) & (table.position_m < end_m)
        at_right = lane >= np.sort(np.unique(road.lane_from_left))[-2]
        for name, where in (("right lanes", at_right), ("left lanes", ~at_right)):
            book.mean(
                Cell(CHANNEL, "residual_mps2", f"merging area, {name}").within(begin_m - 200.0, end_m),
                residual,
                near & where & follows,
            )
            strong = near & where
            cell = Cell(CHANNEL, "residual_share_below_-0.8_mps2", f"merging area, {name}").within(
                begin_m - 200.0, end_m
            )
            book.quotient(cell, (strong & (residual < -0.8)).sum(), strong.sum())
