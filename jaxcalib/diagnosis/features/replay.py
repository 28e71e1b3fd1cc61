"""Features of open-loop replay: what drivers do beyond what the calibrated model does with the same leader.

Each moment at which a vehicle keeps its lane and leader gives a residual: the acceleration over the next interval less
the one that the calibrated model takes from what it meets at both ends. No trajectory is simulated, so that errors do
not pile up, and nothing but the driver's own law is judged.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.closed_loop import SPEED_BORDERS, SPEED_NAMES
from jaxcalib.diagnosis.features.conventions import Conventions, ExpectedDrivers
from jaxcalib.diagnosis.features.features import ROWS_PER_EVENT, Cell, Channel, TallyBook
from surrogate.effects.base import SearchedAt
from surrogate.road.drive_table import NOBODY, DriveTable, RowFlags, RowNumbers, RowValues

CHANNEL = Channel.REPLAY
MOST_RESIDUAL_MPS2 = 3.0
QUIET_S = 2.0  # since the last change of own lane or leader
CHANGE_BORDERS_S = (0.0, 2.0, 4.0, 8.0, 14.0, 25.0)
FOLLOWING_S = 3.5
LAGS_S = (0.5, 1.0, 1.5, 2.0, 3.0)
RECENT_S = 60.0
SLOW_MPS = 8.0
RECOVERY_S = 20.0
LEAST_SAMPLES = 8
NO_LEADER = -9  # no track has this number


@dataclass(frozen=True)
class _Residuals:
    """What drivers do beyond the calibrated model, and when."""

    residual_mps2: RowValues  # acceleration over the next interval less the expected one
    expected_mps2: RowValues  # acceleration that the model takes now
    observed_mps2: RowValues  # acceleration over the next interval
    leader_acceleration_mps2: RowValues  # the same of the leader
    limit_mps: RowValues  # speed limit
    ratio: RowValues  # speed over it
    gap_m: RowValues  # gap to the leader; inf without one
    time_gap_s: RowValues  # the same in time
    leader_track: RowNumbers  # number of the leader
    follows: RowFlags  # whether a leader is near
    since_own_change_s: RowValues  # time since the last change of lane
    since_cut_in_s: RowValues  # time since a newcomer came closer than the leader before
    people: RowFlags  # rows of other drivers who keep lane and leader
    quiet: RowFlags  # rows without a change of lane or leader shortly before
    steady: RowFlags  # rows of people who follow, with nothing new
    free: RowFlags  # rows of people without a leader, with nothing new


def count_replay(
    table: DriveTable, road: Conventions, background: ExpectedDrivers, subject: ExpectedDrivers, book: TallyBook
) -> None:
    """Enter the features of a drive; instants should be 0.5 s apart."""
    keeps = _keeps_lane_and_leader(table)
    seen = _residuals_of(table, road, background, subject, keeps)
    _count_by_regime(book, seen)
    _count_by_place(table, road, book, seen)
    _count_by_history(table, book, seen)
    _count_after_changes(book, seen, seen.people & (table.leader >= 0))
    _count_in_time(table, book, seen)
    _count_between_vehicles(table, book, seen)
    _count_merging(table, road, book, seen)
    is_free = _is_free(table, road)
    at_subject = keeps & table.is_subject & seen.quiet & ((table.leader >= 0) | is_free)
    residual = seen.residual_mps2
    book.mean(Cell(CHANNEL, "residual_mps2", role="subject"), residual, at_subject)
    book.mean(Cell(CHANNEL, "residual_square_m2ps4", role="subject", is_logarithmic=True), residual**2, at_subject)


def _leader_track(table: DriveTable) -> RowNumbers:
    return np.where(table.leader >= 0, table.track[np.maximum(table.leader, 0)], NO_LEADER)


def _is_free(table: DriveTable, road: Conventions) -> RowFlags:
    """Rows without a leader for as far as four seconds."""
    return (table.leader < 0) & (road.log.ahead_m - table.offset_m > 4.0 * table.speed_mps)


def _keeps_lane_and_leader(table: DriveTable) -> RowFlags:
    """Rows whose vehicle has the same lane and the same leader, or none, at the next instant."""
    has_after, later = table.after >= 0, np.maximum(table.after, 0)
    leader_track = _leader_track(table)
    leader_after = np.where(has_after, table.leader[later], NOBODY)
    has_after &= table.lane[later] == table.lane
    return has_after & (leader_track == leader_track[later]) & ((table.leader >= 0) == (leader_after >= 0))


def _residuals_of(
    table: DriveTable, road: Conventions, background: ExpectedDrivers, subject: ExpectedDrivers, keeps: RowFlags
) -> _Residuals:
    step_s, leader = table.interval_s, table.leader
    has, has_after, later = leader >= 0, table.after >= 0, np.maximum(table.after, 0)
    leader_after = np.where(has_after, leader[later], NOBODY)
    gap_m = table.gap_m(road.nominal_length_m)
    leader_mps = np.where(has, table.speed_mps[np.maximum(leader, 0)], 0.0)
    limit_mps = road.limit_at(table.lane, table.position_m)
    expected = _expected_acceleration(table, background, subject, gap_m, leader_mps, limit_mps)
    observed = np.where(has_after, (table.speed_mps[later] - table.speed_mps) / step_s, 0.0)
    residual = observed - 0.5 * (expected + expected[later])
    change = (table.speed_mps[np.maximum(leader_after, 0)] - leader_mps) / step_s

    before, has_before = np.maximum(table.before, 0), table.before >= 0
    own_change = has_before & (table.lane[before] != table.lane)
    leader_track = _leader_track(table)
    leader_before = np.where(has_before, leader_track[before], NO_LEADER)
    new_leader = has_before & has & (leader_track != leader_before) & ~own_change
    closer = new_leader & (gap_m < np.where(has_before, gap_m[before], np.inf) - 3.0)
    since_own_change_s = table.since(own_change)
    quiet = (since_own_change_s > QUIET_S) & (table.since(new_leader) > QUIET_S)
    time_gap_s = gap_m / np.maximum(table.speed_mps, 1.0)
    follows, people = has & (time_gap_s < FOLLOWING_S), keeps & ~table.is_subject
    return _Residuals(
        residual_mps2=np.clip(residual, -MOST_RESIDUAL_MPS2, MOST_RESIDUAL_MPS2),
        expected_mps2=expected,
        observed_mps2=observed,
        leader_acceleration_mps2=np.where(has & (leader_after >= 0), change, 0.0),
        limit_mps=limit_mps,
        ratio=table.speed_mps / limit_mps,
        gap_m=gap_m,
        time_gap_s=time_gap_s,
        leader_track=leader_track,
        follows=follows,
        since_own_change_s=since_own_change_s,
        since_cut_in_s=table.since(closer),
        people=people,
        quiet=quiet,
        steady=people & quiet & follows,
        free=people & quiet & _is_free(table, road),
    )


def _expected_acceleration(
    table: DriveTable,
    background: ExpectedDrivers,
    subject: ExpectedDrivers,
    gap_m: RowValues,
    leader_mps: RowValues,
    limit_mps: RowValues,
) -> RowValues:
    mine = table.is_subject
    desired_mps = np.where(mine, subject.speed_factor, background.speed_factor) * limit_mps
    expected = background.acceleration(table.speed_mps, gap_m, leader_mps, desired_mps)
    expected[mine] = subject.acceleration(table.speed_mps[mine], gap_m[mine], leader_mps[mine], desired_mps[mine])
    return expected


def _residual_cell(regime: str) -> Cell:
    return Cell(CHANNEL, "residual_mps2", regime)


def _count_by_regime(book: TallyBook, seen: _Residuals) -> None:
    residual = seen.residual_mps2
    regime = np.digitize(seen.ratio, SPEED_BORDERS)
    for index, name in enumerate(SPEED_NAMES):
        at = seen.steady & (regime == index)
        book.mean(_residual_cell(f"following, {name}"), residual, at)
        cell = Cell(CHANNEL, "residual_square_m2ps4", f"following, {name}", is_logarithmic=True)
        book.mean(cell, residual**2, at)
    for index in (1, 2, 3):
        book.mean(_residual_cell(f"free, {SPEED_NAMES[index]}"), residual, seen.free & (regime == index))
    book.mean(Cell(CHANNEL, "residual_square_m2ps4", "free", is_logarithmic=True), residual**2, seen.free)


def _count_by_place(table: DriveTable, road: Conventions, book: TallyBook, seen: _Residuals) -> None:
    num_stretches = len(road.stretch_m) - 1
    stretch = np.digitize(table.position_m, road.stretch_m) - 1
    on_stretch = (seen.steady | seen.free) & (stretch >= 0) & (stretch < num_stretches)
    for regime, at in (("slow", seen.ratio < 0.7), ("fast", seen.ratio >= 0.7)):
        now = on_stretch & at
        above = np.bincount(stretch[now], seen.residual_mps2[now], num_stretches)
        below = np.bincount(stretch[now], minlength=num_stretches)
        cell = _residual_cell(regime)._replace(locates=SearchedAt.STRETCHES)
        for index in range(num_stretches):
            book.quotient(cell.within(*road.stretch_m[index : index + 2]), above[index], below[index])


def _count_by_history(table: DriveTable, book: TallyBook, seen: _Residuals) -> None:
    residual, ratio, steady = seen.residual_mps2, seen.ratio, seen.steady
    recent = table.recent_mean(table.speed_mps / seen.limit_mps, RECENT_S)
    seen_s = table.since(table.before < 0)
    for name, low, high in (("slow", 0.2, 0.5), ("dense", 0.5, 0.75)):
        at = steady & (ratio >= low) & (ratio < high) & (seen_s > 15.0)
        book.mean(_residual_cell(f"{name}, after slow traffic"), residual, at & (recent < 0.5))
        book.mean(_residual_cell(f"{name}, after fast traffic"), residual, at & (recent >= 0.5))
    since_slow_s = table.since(table.speed_mps < SLOW_MPS)
    recovering = (since_slow_s > 0.0) & (since_slow_s < RECOVERY_S)
    for name, low, high in (("8 to 11 m/s", 8.0, 11.0), ("11 to 14 m/s", 11.0, 14.0), ("14 to 17 m/s", 14.0, 17.0)):
        at = steady & (table.speed_mps >= low) & (table.speed_mps < high)
        book.mean(_residual_cell(f"{name}, recovering"), residual, at & recovering)
        book.mean(_residual_cell(f"{name}, not recovering"), residual, at & ~recovering)
    slow = steady & (table.speed_mps < SLOW_MPS) & (table.speed_mps > 1.0)
    starting = _leader_pulls_away(table)
    book.mean(_residual_cell("below 8 m/s, starting"), residual, slow & starting)
    book.mean(_residual_cell("below 8 m/s, not starting"), residual, slow & ~starting)


def _leader_pulls_away(table: DriveTable) -> RowFlags:
    """Rows whose leader is faster by more than 0.5 m/s."""
    leader = table.leader
    return (leader >= 0) & (table.speed_mps[np.maximum(leader, 0)] > table.speed_mps + 0.5)


def _count_after_changes(book: TallyBook, seen: _Residuals, chosen: RowFlags) -> None:
    for who, since_s in (
        ("after own lane change", seen.since_own_change_s),
        ("behind a newcomer", seen.since_cut_in_s),
    ):
        for low, high in itertools.pairwise(CHANGE_BORDERS_S):
            at = chosen & (since_s >= low) & (since_s < high) & (seen.time_gap_s < FOLLOWING_S)
            regime = f"{who}, {low:g} to {high:g} s"
            book.mean(_residual_cell(regime), seen.residual_mps2, at)
            book.mean(Cell(CHANNEL, "time_gap_s", regime), seen.time_gap_s, at)


def _count_in_time(table: DriveTable, book: TallyBook, seen: _Residuals) -> None:
    residual, expected, steady = seen.residual_mps2, seen.expected_mps2, seen.steady
    leader, leader_acceleration = table.leader, seen.leader_acceleration_mps2
    lags = {max(1, round(lag_s / table.interval_s)): lag_s for lag_s in reversed(LAGS_S)}  # the shortest of a number
    for instants, lag_s in lags.items():
        earlier = table.later(-instants)
        back = np.maximum(earlier, 0)
        both = steady & (earlier >= 0) & steady[back]
        book.mean(Cell(CHANNEL, "residual_autocovariance_m2ps4", f"{lag_s:g} s"), residual * residual[back], both)
        book.mean(
            Cell(CHANNEL, "residual_with_leader_acceleration_m2ps4", f"{lag_s:g} s"),
            residual * leader_acceleration[back], both,
        )  # fmt: skip
        change = expected - expected[back]
        book.mean(Cell(CHANNEL, "residual_with_expected_change_m2ps4", f"{lag_s:g} s"), residual * change, both)
    book.mean(Cell(CHANNEL, "residual_with_leader_acceleration_m2ps4", "0 s"), residual * leader_acceleration, steady)
    second = np.where(leader >= 0, leader[np.maximum(leader, 0)], NOBODY)
    difference = table.speed_mps[np.maximum(second, 0)] - table.speed_mps[np.maximum(leader, 0)]
    cell = Cell(CHANNEL, "residual_with_second_leader_m2ps3")
    book.mean(cell, residual * np.clip(difference, -5, 5), steady & (second >= 0))
    approach = np.where(leader >= 0, table.speed_mps[np.maximum(leader, 0)] - table.speed_mps, 0.0)
    book.mean(Cell(CHANNEL, "residual_with_approach_m2ps3"), residual * np.clip(approach, -5, 5), steady)
    book.mean(Cell(CHANNEL, "residual_with_expected_m2ps4"), residual * np.clip(expected, -3, 3), steady)
    book.mean(Cell(CHANNEL, "acceleration_square_m2ps4", is_logarithmic=True), seen.observed_mps2**2, steady)


def _count_between_vehicles(table: DriveTable, book: TallyBook, seen: _Residuals) -> None:
    """Between-vehicle spread: the product of two halves' means is free of what varies within a vehicle."""
    at = seen.steady & (seen.ratio > 0.15)
    for name, vehicle in (("drivers", table.track), ("leaders", seen.leader_track)):
        chosen = np.flatnonzero(at)
        order = chosen[np.lexsort((table.instant[chosen], vehicle[chosen]))]
        if not len(order):
            continue
        _, first, count = np.unique(vehicle[order], return_index=True, return_counts=True)
        enough = count >= LEAST_SAMPLES
        total = np.concatenate([[0.0], np.cumsum(seen.residual_mps2[order])])
        half = count // 2
        early = (total[first + half] - total[first]) / np.maximum(half, 1)
        late = (total[first + count] - total[first + half]) / np.maximum(count - half, 1)
        cell = Cell(CHANNEL, "residual_between_vehicles_m2ps4", f"by {name}")
        book.quotient(cell, (early * late)[enough].sum(), enough.sum())
        cell = Cell(CHANNEL, "residual_low_share", f"by {name}", rows_per_event=ROWS_PER_EVENT)
        book.quotient(cell, (enough & (0.5 * (early + late) < -0.3)).sum(), enough.sum())
    _count_alike_followers(table, book, seen, at)
    for border in (-0.8, -0.4, 0.4, 0.8):
        beyond = seen.residual_mps2 < border if border < 0 else seen.residual_mps2 > border
        measure = f"residual_share_{'below' if border < 0 else 'above'}_{border:g}_mps2"
        book.quotient(Cell(CHANNEL, measure, rows_per_event=ROWS_PER_EVENT), (at & beyond).sum(), at.sum())


def _count_alike_followers(table: DriveTable, book: TallyBook, seen: _Residuals, at: RowFlags) -> None:
    """Enter how alike different followers of one leader are: what a vehicle's length does to all who follow it."""
    chosen = np.flatnonzero(at)
    if not len(chosen):
        return
    pair = seen.leader_track[chosen].astype(np.int64) * 100_000 + table.track[chosen]
    unique, inverse, count = np.unique(pair, return_inverse=True, return_counts=True)
    mean = np.bincount(inverse, seen.residual_mps2[chosen]) / count
    enough = count >= LEAST_SAMPLES
    leader, mean = unique[enough] // 100_000, mean[enough]
    _, group, size = np.unique(leader, return_inverse=True, return_counts=True)
    total, square = np.bincount(group, mean), np.bincount(group, mean**2)
    products, pairs = 0.5 * (total**2 - square), 0.5 * size * (size - 1.0)
    book.quotient(Cell(CHANNEL, "residual_alike_behind_one_leader_m2ps4"), products.sum(), pairs.sum())


def _count_merging(table: DriveTable, road: Conventions, book: TallyBook, seen: _Residuals) -> None:
    chosen, residual = seen.people & seen.quiet, seen.residual_mps2
    for begin_m, end_m in road.merge_m:
        lane = road.lane_from_left[table.lane]
        near = chosen & (table.position_m > begin_m - 200.0) & (table.position_m < end_m)
        at_right = lane >= np.sort(np.unique(road.lane_from_left))[-2]
        for name, where in (("right lanes", at_right), ("left lanes", ~at_right)):
            regime = f"merging area, {name}"
            cell = _residual_cell(regime).within(begin_m - 200.0, end_m)
            book.mean(cell, residual, near & where & seen.follows)
            cell = cell._replace(measure="residual_share_below_-0.8_mps2", rows_per_event=ROWS_PER_EVENT)
            book.quotient(cell, (near & where & (residual < -0.8)).sum(), (near & where).sum())
