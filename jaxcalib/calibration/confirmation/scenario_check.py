"""Whether SUMO runs the scenario as it is: asked before anything else, since a search would find out at its end."""

import functools
from collections.abc import Callable, Sequence

from jaxcalib.calibration.confirmation.final_errors import requests_in_turn
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.case.case import Role
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.seeds import FINAL_SEEDS
from sim_adapters.interface import RunOutcome, RunRequest, Status

NUM_RUNS = 2  # what one seed alone shows is no fault of the scenario

Start = Callable[[Sequence[RunRequest]], Callable[[], list[RunOutcome]]]


def scenario_requests(problem: CalibrationProblem, first_seed: int) -> list[RunRequest]:
    """Return runs of the scenario's own values: the first that a calibration makes for its errors before calibration.

    Args:
        problem: the problem.
        first_seed: of the calibration.
    """
    role: Role = "held_out" if problem.drive_starts("held_out") else "fit"
    values = round_values(problem.template.base_values())
    return requests_in_turn(values, problem.drive_starts(role), NUM_RUNS, first_seed + FINAL_SEEDS[role])


def start_scenario_check(problem: CalibrationProblem, first_seed: int, start: Start) -> Callable[[], None]:
    """Start a run of the scenario's own values in the background.

    Args:
        problem: the problem.
        first_seed: of the calibration.
        start: starts runs in SUMO and returns what waits for them.

    Returns:
        What waits for it at the first call, and raises an AllRunsFailedError if SUMO fails at it and at another seed.
    """
    first, second = scenario_requests(problem, first_seed)
    wait = start([first])

    @functools.cache
    def check() -> None:
        (outcome,) = wait()
        if outcome.status is Status.FAILED:
            refuse_failed([outcome, *start([second])()])

    return check


def refuse_failed(outcomes: Sequence[RunOutcome]) -> None:
    """Refuse a scenario of which every run failed; where the entrance is too full for the subject vehicle, SUMO ran.

    Raises:
        AllRunsFailedError: every run failed.
    """
    if all(outcome.status is Status.FAILED for outcome in outcomes):
        raise AllRunsFailedError("SUMO cannot run the scenario as it is", outcomes[0].log_tail)
