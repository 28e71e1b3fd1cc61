"""Several subject vehicles in one SUMO run: each sees what it would alone, as far as others are not there yet."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from sim_adapters.interface import DriveStart, ParameterLayout, RunOutcome, RunRequest, Status
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.shared_runs import departures_s, shared_runs, starts_apart, starts_of, subject_names
from sim_adapters.sumo.distant import DistantTypes
from sim_adapters.sumo.simulator import SensorRange, SumoSimulator

VALUES = (1500.0, 300.0, 1.2, 2.5, 2.6, 1.0, 0.1, 1.0, 1.0)
SEED, FIRST_S, SECOND_S, END_S = 5, 60.0, 90.0, 150.0
EVERY_20_S = (300.0, 320.0, 340.0, 360.0, 380.0, 400.0)


def request_of(depart_s: float, *also_s: float, seed: int = SEED) -> RunRequest:
    return RunRequest(VALUES, seed, depart_s, {}, also_s)


@pytest.mark.parametrize(
    ("departs_s", "least_apart_s", "most", "dealt"),
    [
        (EVERY_20_S, 40.0, 9, [(300.0, 340.0, 380.0), (320.0, 360.0, 400.0)]),
        (EVERY_20_S, 50.0, 9, [(300.0, 360.0), (320.0, 380.0), (340.0, 400.0)]),
        (EVERY_20_S, 20.0, 6, [EVERY_20_S]),
        (EVERY_20_S, 20.0, 5, [(300.0, 340.0, 380.0), (320.0, 360.0, 400.0)]),
        ((600.0,), 40.0, 3, [(600.0,)]),
        ((0.0, 5.0), 40.0, 3, [(0.0,), (5.0,)]),
        ((300.0, 300.0), 40.0, 3, [(300.0,), (300.0,)]),
    ],
)
def test_drives_are_dealt_to_as_few_runs_as_keep_them_apart(
    departs_s: tuple[float, ...], least_apart_s: float, most: int, dealt: list[tuple[float, ...]]
):
    starts = [DriveStart(depart_s, number) for number, depart_s in enumerate(departs_s)]
    found = starts_apart(starts, least_apart_s, most)
    assert [tuple(one.depart_s for one in run) for run in found] == dealt
    assert sorted(one for run in found for one in run) == starts


def test_one_subject_vehicle_stands_for_one_drive():
    """Two drives at 60 s that a run with another at 90 s is asked for are two runs; a further one joins the first."""
    asked = [
        RunRequest(VALUES, SEED, depart_s, {}, (also_s,), drive)
        for depart_s, also_s, drive in ((60.0, 90.0, 3), (60.0, 90.0, 5), (90.0, 60.0, 4), (60.0, 90.0, 3))
    ]
    assert shared_runs(asked) == [[0, 2, 3], [1]]
    assert starts_of([asked[0], asked[2]]) == (DriveStart(60.0, 3), DriveStart(90.0, 4))
    assert starts_of([asked[1]]) == (DriveStart(60.0, 5), DriveStart(90.0))


def test_requests_that_differ_only_in_whom_they_ask_for_share_a_run():
    one, other = request_of(60.0, 90.0), request_of(90.0, 60.0)
    assert departures_s(one) == departures_s(other) == (60.0, 90.0)
    assert shared_runs([one, request_of(60.0), other, request_of(60.0), request_of(60.0, 90.0, seed=6)]) == [
        [0, 2], [1], [3], [4],
    ]  # fmt: skip
    assert len(set(subject_names("ego", (60.0, 90.0, 120.0)))) == 3
    assert subject_names("ego", (60.0,)) == ("ego",)


def fold(frames: Any) -> np.ndarray:
    """Return the whole of what a drive shows, each frame in one number: when, where, how fast, and whom it sees."""
    seen = np.where(frames.object_valid, frames.object_offset_m + frames.object_speed_mps, 0.0).sum(axis=1)
    rows = [frames.time_s, frames.subject_position_m, frames.subject_speed_mps, seen]
    return np.stack(rows).astype(float).ravel()


@pytest.fixture(scope="module")
def sumo(corridor: Scenario, layout: ParameterLayout) -> Iterator[SumoSimulator]:
    with SumoSimulator(corridor, layout, fold, SensorRange(150.0, 150.0), "ego", 0.5, END_S, 1) as simulator:
        yield simulator


def rows_of(outcome: RunOutcome) -> np.ndarray:
    assert outcome.status is Status.OK
    return outcome.observed.reshape(4, -1)


@pytest.mark.long
def test_one_run_shows_the_drive_of_each_of_its_subject_vehicles(sumo: SumoSimulator):
    alone, other, one = sumo.run(
        [request_of(FIRST_S), request_of(SECOND_S, FIRST_S), request_of(FIRST_S, SECOND_S)]
    )  # as if an earlier run of the same worker had had one subject vehicle only
    assert other.num_vehicle_steps == one.num_vehicle_steps > alone.num_vehicle_steps
    assert other.wall_s == one.wall_s
    time_s, position_m, _, seen = rows_of(one)
    before = time_s < SECOND_S
    assert before.sum() > 20
    np.testing.assert_array_equal(rows_of(one)[:, before], rows_of(alone)[:, before])
    assert np.all(seen[before] != 0.0)
    its_time_s, its_position_m, its_speed_mps, _ = rows_of(other)
    assert SECOND_S <= its_time_s[0] < SECOND_S + 5.0
    assert np.all(np.diff(its_position_m) >= 0.0)
    assert its_speed_mps.max() > 5.0
    both = np.intersect1d(time_s, its_time_s)
    ahead_m = position_m[np.isin(time_s, both)] - its_position_m[np.isin(its_time_s, both)]
    assert np.all(ahead_m > 100.0)


@pytest.mark.long
def test_a_vehicle_that_never_enters_does_not_spoil_the_drive_of_another(sumo: SumoSimulator):
    one, other = sumo.run([request_of(FIRST_S, END_S + 10.0), request_of(END_S + 10.0, FIRST_S)])
    assert one.status is Status.OK
    assert other.status is Status.SUBJECT_MISSING


def test_a_subject_vehicle_that_is_not_driven_by_sumo_alone_is_the_only_one(
    corridor: Scenario, layout: ParameterLayout
):
    distant = DistantTypes({}, 150.0, 150.0, 5, 0)
    with SumoSimulator(
        corridor, layout, fold, SensorRange(150.0, 150.0), "ego", 0.5, END_S, 1, distant=distant
    ) as simulator, pytest.raises(ValueError, match="one subject vehicle"):  # fmt: skip
        simulator.run([request_of(FIRST_S, SECOND_S)])
