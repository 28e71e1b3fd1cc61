"""Trials made in two parts are those made at once: each run keeps its seed and its drive."""

from typing import Any, cast

from jaxcalib.diagnosis.runs.trials import Trial, TrialRunner
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest, Status

STARTS = (DriveStart(300.0, 2), DriveStart(340.0), DriveStart(380.0, 7))


class Engine:
    """Keeps what it is asked for; all its runs fail."""

    def __init__(self) -> None:
        self.asked: list[tuple[tuple[float, ...], int, DriveStart]] = []

    def run(self, requests: list[RunRequest]) -> list[RunOutcome]:
        self.asked += [(tuple(one.values), one.seed, one.drive_start) for one in requests]
        failed: Any = {"observed": None, "num_arrived": None, "num_inserted": None, "num_collisions": 0}
        return [RunOutcome(request=one, status=Status.FAILED, **failed) for one in requests]


def asked(*trials: Trial) -> list[tuple[tuple[float, ...], int, DriveStart]]:
    engine, nothing = Engine(), cast(Any, None)
    TrialRunner(cast(Any, engine), nothing, nothing, STARTS, 70, 0.5).run(trials, lambda number: None)
    return engine.asked


def test_further_runs_go_on_where_the_first_ended():
    whole = asked(Trial("a", (1.0, 2.0), 8))
    first, further = Trial("a", (1.0, 2.0), 5), Trial("a", (1.0, 2.0), 3, first_run=5)
    assert asked(first) + asked(further) == whole
    assert len({seed for _, seed, _ in whole}) == 8
    assert [start for *_, start in whole] == [*STARTS, *STARTS, *STARTS[:2]]
