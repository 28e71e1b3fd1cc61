import numpy as np

from jaxcalib.calibration.final_errors import FinalRuns, with_outcomes
from sim_adapters.interface import RunOutcome, RunRequest, Status

DEPARTS_S = (300.0, 340.0, 300.0)


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
    found = with_outcomes(runs, DEPARTS_S, more)
    assert found.tally[:, 0].tolist() == [1.0, 5.0, 7.0, 8.0, 11.0, 12.0]
    assert found.drive.tolist() == [0, 1, 1, 0, 2, 0]
    assert len(found.outcomes) == 6


def test_without_any_that_fit_the_runs_stay_as_they_are():
    runs = FinalRuns(np.asarray([[1.0, 2.0]]), np.asarray([0]), (outcome(300.0, 1),))
    assert with_outcomes(runs, DEPARTS_S, (outcome(320.0, 3), outcome(300.0, 4, Status.FAILED))) is runs
    assert with_outcomes(runs, DEPARTS_S, ()) is runs
