"""What is said of the scenario after its first runs in SUMO, before any search."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration import scenario_runs
from jaxcalib.calibration.confirmation.final_errors import FinalRuns
from jaxcalib.calibration.scenario_runs import scenario_warnings, start_scenario_runs
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest, Status

OUTCOME = RunOutcome(RunRequest((1.0,), 3, 60.0), Status.OK, np.ones(4), np.asarray([100, 20]), np.asarray([99, 20]), 0)
MISSING = replace(OUTCOME, status=Status.SUBJECT_MISSING, observed=None)


def warnings_of(*outcomes: RunOutcome) -> list[str]:
    ok = [outcome for outcome in outcomes if outcome.status.is_ok]
    return scenario_warnings(FinalRuns(np.ones((len(ok), 4)), np.zeros(len(ok), int), outcomes))


def test_a_scenario_that_runs_as_it_should_is_no_news() -> None:
    assert warnings_of(OUTCOME, OUTCOME) == []


def test_a_subject_vehicle_that_stays_outside_is_told_with_what_to_look_at() -> None:
    (line,) = warnings_of(OUTCOME, MISSING, MISSING)
    assert line.startswith("the subject vehicle never entered in 2 of 3 SUMO runs")
    assert "departPos" in line


def test_one_that_does_not_arrive_is_told_with_what_to_change() -> None:
    (line,) = warnings_of(replace(OUTCOME, subject_left=False), OUTCOME)
    assert "had not arrived by the end in 1 of 2" in line
    assert "duration_s" in line


def test_demand_that_finds_no_room_is_told_with_its_share() -> None:
    (line,) = warnings_of(replace(OUTCOME, num_inserted=np.asarray([60, 20])))
    assert line.startswith("33% of the scenario's vehicles had not entered")


PROBLEM: Any = SimpleNamespace(
    template=SimpleNamespace(base_values=lambda: np.asarray([1.0])),
    drive_starts=lambda role: (DriveStart(60.0),),
    tally_names=("a", "b", "c", "d"),
)
PLAN: Any = SimpleNamespace(final_fit_runs=2, noise_runs=4)


def test_a_scenario_of_which_no_run_succeeds_is_refused_with_sumo_s_last_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise AllRunsFailedError(
            "all 2 runs failed: the subject vehicle never entered; the entrance was full", "a word"
        )

    monkeypatch.setattr(scenario_runs, "start_final_runs", lambda *arguments, **options: fail)
    wait = start_scenario_runs(PROBLEM, SimpleNamespace(), PLAN, SimpleNamespace())  # pyright: ignore
    with pytest.raises(AllRunsFailedError, match="cannot run the scenario as it is: all 2 runs failed") as error:
        wait()
    assert error.value.log_tail == "a word"
