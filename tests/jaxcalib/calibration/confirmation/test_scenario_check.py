"""SUMO runs the scenario as it is before anything is searched, in a run that is needed anyway."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.final_errors import start_final_runs
from jaxcalib.calibration.confirmation.scenario_check import scenario_requests, start_scenario_check
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.cli import app as cli
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.journal import Journal, JournaledSumo
from jaxcalib.runs.seeds import FINAL_SEEDS
from jaxcalib.runs.session import open_session
from sim_adapters.interface import RunOutcome, RunRequest, Status
from tests.copies import copy_corridor
from tests.places import CORRIDOR

FIRST_SEED = 3_000_000


class ScriptedSumo:
    """Ends runs, in the order in which they are asked for, as it is told; well after that."""

    def __init__(self, *ends: Status) -> None:
        self.ends, self.made = list(ends), []

    def submit(self, requests: Sequence[RunRequest]):
        return iter([self._run(request) for request in requests])

    def _run(self, request: RunRequest) -> Callable[[], RunOutcome]:
        self.made.append(request)
        status = self.ends.pop(0) if self.ends else Status.OK
        none = np.zeros(2, int)
        words = f"words of seed {request.seed}" if status is Status.FAILED else ""
        outcome = RunOutcome(request, status, np.ones(3) if status.is_ok else None, none, none, 0, log_tail=words)
        return lambda: outcome


@pytest.fixture(scope="module")
def problem() -> CalibrationProblem:
    return read_problem(CORRIDOR)


def checked(problem: CalibrationProblem, *ends: Status) -> list[int]:
    """Check a scenario whose runs end like that; return the seeds that were run, less the first of final errors."""
    sumo = ScriptedSumo(*ends)
    check = start_scenario_check(problem, FIRST_SEED, JournaledSumo(sumo, Journal(None)).start)  # pyright: ignore
    check()
    check()
    return [request.seed - FIRST_SEED - FINAL_SEEDS["held_out"] for request in sumo.made]


@pytest.mark.parametrize(
    ("ends", "seeds"),
    [
        ((Status.OK,), [0]),
        ((Status.SUBJECT_MISSING,), [0]),  # the scenario's own demand may fill the entrance
        ((Status.FAILED, Status.OK), [0, 1]),  # what one seed alone shows is no fault of the scenario
    ],
)
def test_one_run_is_enough_where_sumo_runs_the_scenario(
    problem: CalibrationProblem, ends: tuple[Status, ...], seeds: list[int]
):
    assert checked(problem, *ends) == seeds


def test_a_scenario_that_fails_twice_is_refused_with_the_first_words(problem: CalibrationProblem):
    with pytest.raises(AllRunsFailedError, match="SUMO cannot run the scenario as it is") as error:
        checked(problem, Status.FAILED, Status.FAILED)
    assert error.value.log_tail == f"words of seed {FIRST_SEED + FINAL_SEEDS['held_out']}"


def test_the_run_is_one_of_those_for_the_errors_before_calibration(problem: CalibrationProblem):
    sumo = ScriptedSumo()
    journaled = JournaledSumo(sumo, Journal(None))  # pyright: ignore[reportArgumentType]
    start_scenario_check(problem, FIRST_SEED, journaled.start)()
    values = round_values(problem.template.base_values())
    with open_session(None, {}, seed=3) as session:
        start_final_runs(problem, journaled, values, "held_out", 6, session)
    assert len(sumo.made) == 6
    assert scenario_requests(problem, FIRST_SEED) == sumo.made[:2]


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """A case that only SUMO finds fault with, when the subject vehicle comes."""
    case = copy_corridor(tmp_path / "case", "d01", "d03")
    demand = case / "scenario" / "demand.rou.xml"
    demand.write_text(demand.read_text().replace('id="ego"', 'id="ego" departPosLat="nowhere"', 1))
    return case


@pytest.fixture
def without_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nobody search, or simulate with anything but SUMO."""
    from jaxcalib.calibration import first_values, pipeline, value_search
    from jaxcalib.diagnosis.stages import calibrated

    def search(*arguments: object, **options: object) -> None:
        raise AssertionError("the search has begun")

    for module in (pipeline, calibrated):
        monkeypatch.setattr(module, "surrogate_engine", lambda problem: SimpleNamespace(prepare=lambda: None))
    monkeypatch.setattr(first_values, "find_initial_point", lambda *arguments: arguments[-1]())
    monkeypatch.setattr(value_search, "search_two_stages", search)


def calibrated(problem: CalibrationProblem, folder: Path) -> Path:
    """Leave what a validation needs of a calibration."""
    values, layout = problem.template.base_values().tolist(), problem.layout
    behaviour = dict(zip(layout.attributes, values[layout.num_inputs :], strict=True))
    parameters = {"demand": dict(zip(layout.input_ids, values, strict=False)), "behaviour": {"car": behaviour}}
    folder.mkdir()
    (folder / "result.json").write_text(json.dumps({"format": 1, "parameters": parameters}))
    return folder


@pytest.mark.long
@pytest.mark.parametrize("command", ["calibrate", "diagnose", "validate", "sweep"])
def test_a_scenario_that_sumo_refuses_ends_with_sumo_s_words_before_any_search(
    command: str,
    broken: Path,
    problem: CalibrationProblem,
    without_search: None,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
):
    out = tmp_path / "run"
    if command == "sweep":
        code = cli.sweep(broken, out=out / "sweep.parquet", design="lhs:4", seeds=1, engine="sumo", quiet=True)
    elif command == "validate":
        code = cli.validate(broken, calibrated(problem, tmp_path / "before"), out=out, seeds=3, quiet=True)
    else:
        code = getattr(cli, command)(broken, out=out, quiet=True)
    assert code == EXIT_CASE_WRONG
    line = capfd.readouterr().err
    assert line.startswith(
        "jaxcalib: scenario.sumocfg: SUMO refuses the scenario: Invalid departPosLat definition for vehicle 'ego'"
    )
    assert line.count("\n") == 1
    assert not list(out.rglob("*.json"))  # it is refused while the case is read, before anything is begun
