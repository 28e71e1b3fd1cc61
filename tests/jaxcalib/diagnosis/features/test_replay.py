"""Residuals of open-loop replay against accelerations that were planted on top of the model's own."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.features.conventions import ExpectedDrivers
from jaxcalib.diagnosis.features.features import Cell, TallyBook
from jaxcalib.diagnosis.features.replay import CHANNEL, count_replay
from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from tests.jaxcalib.diagnosis.features.planted_traffic import (
    LEFT,
    LENGTH_M,
    RIGHT,
    SUBJECT,
    Motion,
    steady,
    table_of,
    tallies,
    value,
)  # fmt: skip
from tests.jaxcalib.diagnosis.synthetic import ROAD

FINE_S, COARSE = 0.1, 5
NUM = 160
A, B, T, S0, V0 = 1.2, 1.8, 1.3, 2.4, 25.0
DRIVER = ExpectedDrivers(
    vehicle_class(
        attribute_values(
            {"accel": f"{A}", "decel": f"{B}", "tau": f"{T}", "minGap": f"{S0}", "delta": "4", "speedDev": "0"}, "IDM"
        ),
        "IDM",
    ),
    FINE_S,
)
# what is observed is a mean over 0.5 s, what is expected that of its two ends: they differ by the second derivative
# of the acceleration times 0.5^2 / 12, which is below 0.01 m/s^2 for waves of 18 s
SAMPLING_MPS2 = 0.02

Extra = Callable[[int, float], float]  # acceleration on top of the model's, for a driver at a place


def idm(speed: float, gap: float, leader_speed: float) -> float:
    """Return the acceleration of Treiber, Hennecke & Helbing (2000), eqs. (2) and (3)."""
    wanted = S0 + max(0.0, speed * T + speed * (speed - leader_speed) / (2.0 * np.sqrt(A * B)))
    return A * (1.0 - (speed / V0) ** 4 - (wanted / gap) ** 2)


def platoon(num_followers: int, extra: Extra) -> list[Motion]:
    """Return a subject vehicle whose speed swings and followers who drive by the model, and by what is added to it."""
    num_fine = (NUM - 1) * COARSE + 1
    time_s = FINE_S * np.arange(num_fine)
    lead_mps = 15.0 + 2.0 * np.sin(time_s / 2.9)
    lead_m = 400.0 + np.concatenate([[0.0], np.cumsum(FINE_S * 0.5 * (lead_mps[1:] + lead_mps[:-1]))])
    ahead = Motion(SUBJECT, np.full(num_fine, RIGHT), lead_m, lead_mps)
    motions = [ahead]
    for number in range(num_followers):
        speed, place = np.zeros(num_fine), np.zeros(num_fine)
        speed[0], place[0] = 15.0, ahead.position_m[0] - LENGTH_M - 27.0
        for step in range(num_fine - 1):
            gap = ahead.position_m[step] - LENGTH_M - place[step]
            change = FINE_S * (idm(speed[step], gap, ahead.speed_mps[step]) + extra(number, place[step]))
            speed[step + 1] = speed[step] + change
            place[step + 1] = place[step] + FINE_S * (speed[step] + 0.5 * change)
        ahead = Motion(number, np.full(num_fine, RIGHT), place, speed)
        motions.append(ahead)
    return [Motion(one.track, one.row[::COARSE], one.position_m[::COARSE], one.speed_mps[::COARSE]) for one in motions]


def counted(motions: list[Motion], merge_m: np.ndarray | None = None) -> TallyBook:
    book = TallyBook()
    road = ROAD if merge_m is None else replace(ROAD, merge_m=merge_m)
    count_replay(table_of(motions), road, DRIVER, DRIVER, book)
    return book


def residual(book: TallyBook, regime: str, **where: float) -> float:
    return value(book, Cell(CHANNEL, "residual_mps2", regime, **where))  # pyright: ignore[reportArgumentType]


def test_the_model_s_own_drivers_leave_no_residual() -> None:
    book = counted(platoon(4, lambda number, place_m: 0.0))
    assert residual(book, "following, dense") == pytest.approx(0.0, abs=SAMPLING_MPS2)
    assert value(book, Cell(CHANNEL, "residual_between_vehicles_m2ps4", "by drivers")) < SAMPLING_MPS2**2


@pytest.mark.parametrize("gap_m", [16.0, 24.0, 40.0])
def test_at_a_constant_speed_and_gap_the_residual_is_what_the_model_would_do_less(gap_m: float) -> None:
    speed = 16.0
    pair = [steady(1, RIGHT, 500.0, speed, NUM), steady(2, RIGHT, 500.0 - LENGTH_M - gap_m, speed, NUM)]
    far_away = steady(SUBJECT, RIGHT, 350.0, speed, NUM)
    book = counted([*pair, far_away])
    assert residual(book, "following, dense") == pytest.approx(-idm(speed, gap_m, speed), abs=1e-4)
    square = Cell(CHANNEL, "residual_square_m2ps4", "following, dense", is_logarithmic=True)
    assert value(book, square) == pytest.approx(idm(speed, gap_m, speed) ** 2, abs=1e-4)


def test_what_happens_at_a_place_shows_there_and_nowhere_else() -> None:
    book = counted(platoon(3, lambda number, place_m: -0.25 * (800.0 <= place_m < 1200.0)))
    for from_m in np.arange(400.0, 1400.0, 200.0):
        found = [
            tallies(book, Cell(CHANNEL, "residual_mps2", name).within(from_m, from_m + 200.0))
            for name in ("slow", "fast")
        ]
        above, below = np.sum(found, axis=0)
        expected = -0.25 if 800.0 <= from_m < 1200.0 else 0.0
        # one of 13 half seconds in which a vehicle passes a stretch lies across its border
        assert above / below == pytest.approx(expected, abs=SAMPLING_MPS2 + 0.25 / 13)


def test_drivers_who_differ_are_told_from_drivers_who_waver() -> None:
    """The product of two halves' means is the square of what a driver adds for good."""
    offsets = (0.2, -0.15, 0.1, -0.2)
    book = counted(platoon(4, lambda number, place_m: offsets[number]))
    between = value(book, Cell(CHANNEL, "residual_between_vehicles_m2ps4", "by drivers"))
    assert between == pytest.approx(np.mean(np.square(offsets)), abs=0.005)
    late = value(book, Cell(CHANNEL, "residual_autocovariance_m2ps4", "3 s"))
    assert late == pytest.approx(np.mean(np.square(offsets)), abs=0.005)
    assert residual(book, "following, dense") == pytest.approx(np.mean(offsets), abs=SAMPLING_MPS2)

    wavers = counted(platoon(4, lambda number, place_m: 0.2 * (-1.0) ** (place_m // 22.5)))  # every 1.5 s
    assert abs(value(wavers, Cell(CHANNEL, "residual_between_vehicles_m2ps4", "by drivers"))) < 0.002
    assert value(wavers, Cell(CHANNEL, "residual_autocovariance_m2ps4", "0.5 s")) > 0.005
    assert value(wavers, Cell(CHANNEL, "residual_autocovariance_m2ps4", "1.5 s")) < -0.005


def test_what_followers_of_one_leader_have_in_common_is_the_product_of_their_residuals() -> None:
    """The first follower leaves the lane after half of the time; from then on the second follows that leader, too."""
    speed, gap_m = 16.0, 20.0
    behind = [500.0 - number * (gap_m + LENGTH_M) for number in range(3)]
    rows = np.where(np.arange(NUM) < NUM // 2, RIGHT, LEFT)
    motions = [steady(1, RIGHT, behind[0], speed, NUM), steady(2, rows, behind[1], speed, NUM)]
    motions += [steady(3, RIGHT, behind[2], speed, NUM), steady(SUBJECT, RIGHT, 300.0, speed, NUM)]
    found = value(counted(motions), Cell(CHANNEL, "residual_alike_behind_one_leader_m2ps4"))
    near, far = idm(speed, gap_m, speed), idm(speed, 2.0 * gap_m + LENGTH_M, speed)
    assert found == pytest.approx(near * far, abs=1e-4)


def test_before_a_merge_the_right_lanes_are_judged_on_their_own() -> None:
    merge_m = np.asarray([[1000.0, 1200.0]])
    book = counted(platoon(3, lambda number, place_m: -0.3 * (800.0 <= place_m < 1200.0)), merge_m)
    cell = Cell(CHANNEL, "residual_mps2", "merging area, right lanes").within(800.0, 1200.0)
    assert value(book, cell) == pytest.approx(-0.3, abs=SAMPLING_MPS2 + 0.3 / 26)


def test_the_subject_vehicle_s_residuals_are_its_own() -> None:
    """It drives freely, and freely it would accelerate."""
    speed = 15.0
    book = counted([steady(SUBJECT, RIGHT, 500.0, speed, NUM), steady(1, RIGHT, 380.0, speed, NUM)])
    expected = -A * (1.0 - (speed / V0) ** 4)
    assert value(book, Cell(CHANNEL, "residual_mps2", role="subject")) == pytest.approx(expected, abs=1e-3)
