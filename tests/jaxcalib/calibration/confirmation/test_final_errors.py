from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.final_errors import (
    FinalRuns,
    final_errors,
    runs_of_role,
    start_final_runs,
    with_outcomes,
)
from jaxcalib.calibration.result.simulation_health import health_of, missing_warnings, unfinished_warnings
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.case.case import Role
from jaxcalib.runs.seeds import FINAL_SEEDS, SEEDS_PER_CALIBRATION
from jaxcalib.runs.session import open_session
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest, Status

STARTS = (DriveStart(300.0), DriveStart(340.0), DriveStart(300.0))


def outcome(depart_s: float, value: float, status: Status = Status.OK) -> RunOutcome:
    observed = np.asarray([value, 2.0 * value]) if status.is_ok else None
    return RunOutcome(RunRequest((1.0,), int(value), depart_s), status, observed, np.ones(1), np.ones(1), 0)


def test_other_runs_stand_for_the_drives_that_depart_as_they_do_in_turn():
    runs = FinalRuns(np.asarray([[1.0, 2.0], [5.0, 10.0]]), np.asarray([0, 1]), (outcome(300.0, 1), outcome(340.0, 5)))
    more = (
        outcome(340.0, 7),
        outcome(300.0, 8),
        outcome(320.0, 9),
        outcome(300.0, 10, Status.FAILED),
        outcome(300.0, 11),
        outcome(300.0, 12),
    )
    found = with_outcomes(runs, STARTS, more)
    assert found.tally[:, 0].tolist() == [1.0, 5.0, 7.0, 8.0, 11.0, 12.0]
    assert found.drive.tolist() == [0, 1, 1, 0, 2, 0]
    assert len(found.outcomes) == 6


def test_runs_stand_for_the_drives_that_they_name_alone():
    """Drives 4 and 6 are logged on a part of the route: a run that is observed on all of it stands for neither."""
    starts = (DriveStart(300.0, 4), DriveStart(300.0), DriveStart(300.0, 6))
    of_part, of_all = outcome(300.0, 8), outcome(300.0, 9)
    of_part = replace(of_part, request=replace(of_part.request, drive=6))
    other = replace(of_part, request=replace(of_part.request, drive=5))
    runs = FinalRuns(np.zeros((0, 2)), np.zeros(0, int), ())
    found = with_outcomes(runs, starts, (of_part, of_all, other))
    assert found.tally[:, 0].tolist() == [8.0, 9.0]
    assert found.drive.tolist() == [2, 1]


def test_without_any_that_fit_the_runs_stay_as_they_are():
    runs = FinalRuns(np.asarray([[1.0, 2.0]]), np.asarray([0]), (outcome(300.0, 1),))
    assert with_outcomes(runs, STARTS, (outcome(320.0, 3), outcome(300.0, 4, Status.FAILED))) is runs
    assert with_outcomes(runs, STARTS, ()) is runs


def test_drives_may_share_runs_and_each_is_made_equally_often():
    asked: list[RunRequest] = []

    def start(requests: list[RunRequest], on_run: Any) -> Callable[[], list[RunOutcome]]:
        asked.extend(requests)
        return lambda: [replace(outcome(one.depart_s, one.depart_s + one.seed), request=one) for one in requests]

    departs_s = (300.0, 320.0, 360.0, 300.0, 320.0, 360.0)
    problem: Any = SimpleNamespace(drive_starts=lambda role: tuple(map(DriveStart, departs_s)), tally_names=("a", "b"))
    sumo: Any = SimpleNamespace(start=start)
    with open_session(None, {}, seed=3) as session:
        runs = start_final_runs(problem, sumo, np.ones(1), "held_out", 12, session, shares_runs=True)()
        alone = start_final_runs(problem, sumo, np.ones(1), "held_out", 6, session)()
    assert sorted(runs.drive) == sorted([*range(6), *range(6)])
    assert [departs_s[drive] for drive in runs.drive] == [one.depart_s for one in asked[:12]]
    together = [(one.seed, sorted({one.depart_s, *one.also_depart_s})) for one in asked[:12] if one.also_depart_s]
    assert together
    assert all(other == [300.0, 360.0] for _, other in together)
    assert len({(one.seed, one.depart_s) for one in asked[:12]}) == 12  # none is made twice
    assert alone.drive.tolist() == list(range(6))
    first = 3 * SEEDS_PER_CALIBRATION + FINAL_SEEDS["held_out"]
    assert [(one.seed, one.depart_s) for one in asked[12:]] == [(first + n, departs_s[n]) for n in range(6)]


def test_held_out_drives_none_of_which_can_be_run_leave_no_errors_and_a_warning():
    """An entrance may be full by the time they depart: a calibration must not end without a result for that."""

    def start(requests: list[RunRequest], on_run: Any) -> Callable[[], list[RunOutcome]]:
        return lambda: [outcome(one.depart_s, one.seed, Status.SUBJECT_MISSING) for one in requests]

    problem: Any = SimpleNamespace(
        drive_starts=lambda role: (DriveStart(300.0), DriveStart(320.0)),
        tally_names=("a", "b"),
        field_of=lambda role: np.ones((2, 2)),
    )
    sumo: Any = SimpleNamespace(start=start)
    with open_session(None, {}, seed=3) as session:
        found = start_final_runs(problem, sumo, np.ones(1), "held_out", 4, session, may_fail=True)()
        with pytest.raises(AllRunsFailedError, match="all 4 runs failed: the subject vehicle never entered"):
            start_final_runs(problem, sumo, np.ones(1), "held_out", 4, session)()
    assert (found.tally.shape, len(found.drive), len(found.outcomes)) == ((0, 2), 0, 4)
    runs: dict[Role, FinalRuns] = {"fit": FinalRuns(np.zeros((0, 2)), np.zeros(0, int), ()), "held_out": found}
    alone = runs_of_role(problem, runs, "held_out")
    assert final_errors(problem, "held_out", alone, None) is None
    outcomes = {"calibrated": found.outcomes, "the scenario's": (outcome(300.0, 1),)}
    (warning,) = missing_warnings(outcomes)
    assert warning.startswith(
        "All 4 runs on held-out drives failed with calibrated values in SUMO: the subject vehicle"
    )
    assert missing_warnings({"calibrated": ()}) == []


def test_runs_for_one_role_serve_the_other_each_drive_equally_often():
    """The drives to fit depart at 300 and 340 s, the one held out at 340 s: its run may stand for the second."""
    problem = SimpleNamespace(
        drive_starts={"fit": (DriveStart(300.0), DriveStart(340.0)), "held_out": (DriveStart(340.0),)}.__getitem__
    )
    fit = FinalRuns(np.asarray([[1.0, 2.0], [3.0, 6.0]]), np.arange(2), (outcome(300.0, 1), outcome(340.0, 3)))
    held_out = FinalRuns(np.asarray([[5.0, 10.0]]), np.asarray([0]), (outcome(340.0, 5),))
    runs = {"fit": fit, "held_out": held_out}
    found = runs_of_role(problem, runs, "held_out")  # pyright: ignore[reportArgumentType]
    assert found.tally[:, 0].tolist() == [5.0, 3.0]
    # a third run for the second drive would weigh it more than the first
    found = runs_of_role(problem, runs, "fit")  # pyright: ignore[reportArgumentType]
    assert found.tally[:, 0].tolist() == [1.0, 3.0]


def test_drives_that_did_not_arrive_are_counted_and_warned_of():
    runs = [replace(outcome(300.0, seed), subject_left=seed != 2) for seed in range(4)]
    runs.append(replace(outcome(300.0, 4, Status.FAILED), subject_left=False))  # it failed, which is counted elsewhere
    health = {"calibrated": health_of(runs), "surrogate": health_of(runs[:2])}
    assert [one.unfinished for one in health.values()] == [1, 0]
    (warning,) = unfinished_warnings(health)
    assert "1 in 5 runs (calibrated)" in warning


def test_drives_that_share_a_run_count_once_in_its_health():
    none = np.asarray([10])

    def drive(depart_s: float, also_s: tuple[float, ...], status: Status) -> RunOutcome:
        request = RunRequest((1.0,), 5, depart_s, also_depart_s=also_s)
        return RunOutcome(request, status, None, none, none - 1, num_collisions=3, num_teleports=2)

    shared = [drive(300.0, (360.0,), Status.OK), drive(360.0, (300.0,), Status.SUBJECT_MISSING)]
    alone = [drive(300.0, (), Status.OK), drive(300.0, (), Status.OK)]
    health = health_of([*shared, *alone])
    assert (health.runs, health.failed, health.collisions, health.teleports) == (3, 1, 9, 6)
    assert health.backlog_share == 0.1
