"""Statistics hang on what a feature says of itself: with other names for all features they stay the same."""

from typing import cast

import numpy as np
import pytest

from jaxcalib.diagnosis.features.closed_loop import count_closed_loop
from jaxcalib.diagnosis.features.conventions import Conventions, ExpectedDrivers
from jaxcalib.diagnosis.features.features import Cell, DriveTallies, TallyBook
from jaxcalib.diagnosis.features.identities import count_identities
from jaxcalib.diagnosis.features.noise import NullModel, null_model, observed_cells, on_cells
from jaxcalib.diagnosis.features.replay import count_replay
from jaxcalib.diagnosis.inference.atlas import altered_exactness
from jaxcalib.diagnosis.inference.local_search import windows_of_effects
from jaxcalib.diagnosis.inference.marginal_likelihood import groups_of
from surrogate.effects.base import SearchedAt
from surrogate.effects.registry import EFFECT_NAMES
from surrogate.road.drive_table import DriveTable, LogFormat

NUM_INSTANTS, NUM_VEHICLES, NUM_RUNS, NUM_FIELD, NUM_PARAMETERS = 400, 14, 40, 8, 3
ROAD = Conventions(
    step_s=0.1,
    nominal_length_m=4.8,
    stretch_m=np.linspace(0.0, 2000.0, 11),
    period_s=np.arange(0.0, 180.0, 60.0),
    lane_from_left=np.asarray([2, 1]),
    segment_end_m=np.asarray([np.inf]),
    limit_mps=np.full((2, 1), 25.0),
    merge_m=np.asarray([(600.0, 900.0)]),
    log=LogFormat(ahead_m=150.0, behind_m=120.0, place_step_m=0.01, speed_step_mps=0.01 / 3.6),
)


class Idle:
    """Drivers who are expected to keep their speed."""

    speed_factor = 1.0

    def acceleration(self, speed_mps: np.ndarray, *situation: np.ndarray) -> np.ndarray:
        del situation
        return np.zeros_like(speed_mps)


def some_drive(interval_s: float) -> DriveTable:
    """Return vehicles of two lanes at speeds of their own; some change lane."""
    random = np.random.default_rng(3)
    time_s = interval_s * np.arange(NUM_INSTANTS)
    speed_mps = random.uniform(8.0, 24.0, NUM_VEHICLES) + np.sin(0.3 * time_s)[:, None]
    start_m = random.uniform(200.0, 500.0, NUM_VEHICLES)
    position_m = start_m + np.cumsum(interval_s * speed_mps, axis=0)
    lane = (np.arange(NUM_VEHICLES) + (time_s[:, None] > random.uniform(5.0, 30.0, NUM_VEHICLES))) % 2
    offset_m = position_m - position_m[:, :1]
    instant, vehicle = np.nonzero(np.abs(offset_m) < 110.0)
    return DriveTable(
        interval_s=interval_s,
        time_s=time_s,
        is_valid=np.ones(NUM_INSTANTS, bool),
        subject_acceleration_mps2=np.gradient(speed_mps[:, 0], interval_s),
        subject_speed_mps=speed_mps[:, 0],
        instant=instant,
        track=vehicle - 1,
        lane=lane[instant, vehicle],
        offset_m=offset_m[instant, vehicle],
        position_m=position_m[instant, vehicle],
        speed_mps=speed_mps[instant, vehicle],
        lateral_m=np.zeros(len(instant)),
    ).sorted()


@pytest.fixture(scope="module")
def cells() -> tuple[Cell, ...]:
    """Return all features there are."""
    book = TallyBook()
    count_identities(some_drive(0.1), ROAD, book)
    count_closed_loop(some_drive(0.5), ROAD, book)
    drivers = cast(ExpectedDrivers, Idle())
    count_replay(some_drive(0.5), ROAD, drivers, drivers, book)
    return tuple(book.sums)


def renamed(cells: tuple[Cell, ...]) -> tuple[Cell, ...]:
    """Return the features under names that say nothing; what was called alike is called alike."""
    measures, regimes = (dict.fromkeys(getattr(cell, name) for cell in cells) for name in ("measure", "regime"))
    number_of = {name: f"x{number}" for number, name in enumerate((*measures, *regimes))}
    return tuple(
        cell._replace(measure=number_of[cell.measure], regime=number_of[cell.regime] if cell.regime else "")
        for cell in cells
    )


def tallies(cells: tuple[Cell, ...], num_drives: int, seed: int) -> DriveTallies:
    random = np.random.default_rng(seed)
    below = random.uniform(50.0, 150.0, (num_drives, len(cells)))
    ratio = np.linspace(0.02, 1.5, len(cells)) * random.uniform(0.8, 1.2, below.shape)
    return DriveTallies(cells, ratio * below, below, np.zeros(num_drives))


def model_of(cells: tuple[Cell, ...]) -> tuple[tuple[Cell, ...], NullModel, np.ndarray]:
    null, field = tallies(cells, NUM_RUNS, 1), tallies(cells, NUM_FIELD, 2)
    observed = observed_cells(field, null)
    random = np.random.default_rng(4)
    slope = random.standard_normal((len(cells), NUM_PARAMETERS))[: len(observed)]
    below = on_cells(field, observed).below.sum(axis=0)
    model = null_model(observed, below, null, slope, 0.1 * np.abs(slope), np.ones(NUM_PARAMETERS), None, NUM_FIELD)
    return observed, model, model.standardised(on_cells(field, observed).values())


def test_other_names_give_the_same_null_model_windows_and_exactness(cells: tuple[Cell, ...]):
    others = renamed(cells)
    assert len(set(others)) == len(cells)
    observed, model, difference = model_of(cells)
    other_observed, other, other_difference = model_of(others)
    assert other_observed == tuple(others[cells.index(cell)] for cell in observed)
    for name in ("mean", "deviation", "covariance", "noise", "slope"):
        np.testing.assert_array_equal(getattr(other, name), getattr(model, name))
    np.testing.assert_array_equal(other_difference, difference)
    assert windows_of_effects(difference, other, ROAD) == windows_of_effects(difference, model, ROAD)
    for effect in EFFECT_NAMES:
        np.testing.assert_array_equal(altered_exactness(effect, other.cells), altered_exactness(effect, model.cells))
    for group, other_group in zip(groups_of(model.cells), groups_of(other.cells), strict=True):
        np.testing.assert_array_equal(group, other_group)


def test_what_is_left_to_names_is_there_to_be_lost(cells: tuple[Cell, ...]):
    """The law above means something: features have tolerances, count events, locate and read."""
    for name in ("tolerance", "rows_per_event", "locates", "reads"):
        assert len({getattr(cell, name) for cell in cells}) > 1
    bare = tuple(Cell(cell.channel, cell.measure, cell.regime, cell.role, *cell[4:10]) for cell in cells)
    assert not np.array_equal(tallies(bare, 3, 1).tolerance, tallies(cells, 3, 1).tolerance)


def test_tracks_that_come_and_go_have_a_tolerance(cells: tuple[Cell, ...]):
    lost_and_found = [cell for cell in cells if cell.measure in ("lost_inside_range_phs", "found_inside_range_phs")]
    assert len(lost_and_found) == 2
    assert all(cell.tolerance > 0.0 for cell in lost_and_found)


def test_each_direction_has_windows_of_its_own_and_slow_spells_are_places_too(cells: tuple[Cell, ...]):
    """Wherever residuals of car-following say that vehicles gain speed, what slows them has no stretch of its own."""
    observed, model, _ = model_of(cells)
    by_stretch = np.asarray([cell.locates == SearchedAt.STRETCHES for cell in observed])
    spells = [cell for cell in observed if cell.locates == SearchedAt.SPELLS and cell.from_m is not None]
    slow = min(cell.from_m for cell in spells if cell.from_m is not None)
    is_slow = np.asarray([cell in spells and cell.from_m == slow for cell in observed])
    difference = np.where(by_stretch, 3.0, 0.0) - np.where(is_slow, 6.0, 0.0)
    windows, _ = windows_of_effects(difference, model, ROAD)
    (where,) = windows["local_speed_reduction"]
    assert where.from_m == slow
    assert (where.from_s, where.to_s, where.sign) == (None, None, 1.0)
    assert any(window.sign == -1.0 for window in windows["grade"])
    both, _ = windows_of_effects(np.where(by_stretch, -3.0, 0.0), model, ROAD)
    assert all(window.sign == 1.0 for window in both["local_speed_reduction"])
    assert both["local_speed_reduction"]
