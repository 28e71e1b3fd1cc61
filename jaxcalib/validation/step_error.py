"""What the length of a step makes of the quantities: the same rounds of drives in SUMO with half of it.

SUMO moves vehicles from step to step and its drivers decide at each; a scenario's step is a choice, and what another
would change is an error of the simulation that no field is needed for. Other seeds are run, for half the step draws
other random numbers anyway; so the difference is told with its interval, and held against the margin within which the
quantity counts as the same as the field's.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxcalib.errors import CaseError
from jaxcalib.measures.measure import Moe
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.journal import JournaledSumo
from jaxcalib.runs.session import Session
from jaxcalib.validation.equivalence import OPEN, compare_within_margins
from jaxcalib.validation.margins import Margin
from jaxcalib.validation.observer import DriveObserver, ObservedDrives
from jaxcalib.validation.rounds import complete_rounds
from sim_adapters.interface import RunRequest
from surrogate.subject.registry import REPLAY

TOO_FEW = "not enough rounds"


def check_half_step(problem: CalibrationProblem) -> None:
    """Refuse a case whose subject vehicle has a place for each of the scenario's steps.

    Raises:
        CaseError: it replays its log.
    """
    if problem.parts.subject.model.name == REPLAY:
        expected = "expected a subject vehicle that a model drives; one that replays its log has the scenario's steps."
        raise CaseError("command line", "--half-step", expected)


def step_error(
    problem: CalibrationProblem,
    observer: DriveObserver,
    margins: Mapping[Moe, Margin],
    rounds: ObservedDrives,
    requests: Sequence[RunRequest],
    session: Session,
) -> dict[str, Any]:
    """Run rounds of drives with half the step, and return by how much each quantity differs with the scenario's.

    Args:
        problem: the problem.
        observer: fold over a drive.
        margins: of each MoE.
        rounds: with the scenario's step, [round, drive].
        requests: as many runs, on seeds that no others have.
        session: keeps the runs and is told of them.

    Returns:
        `step_s`, `half_step_s`, `runs`, `num_rounds`, and by measure in `quantities`: `half_step` and `step` (values),
        `difference` (of that with the scenario's step, as a share of that with half of it), `interval_90`, `margin`,
        `verdict`.

    Raises:
        AllRunsFailedError: hardly any round succeeds.
    """
    step_s = problem.parts.scenario.step_s
    half_step_s = 0.5 * step_s
    with sumo_engine(problem, fold=observer, workers=session.sumo_workers, step_s=half_step_s) as pool:
        outcomes = JournaledSumo(pool, session.journal).start(requests, session.progress.sumo_runs)()
    halved = observer.parts(complete_rounds(outcomes, rounds.tally.shape[1]))
    together = ObservedDrives(halved.tally.sum(axis=1), {}, np.zeros(0))  # a round counts as a drive does elsewhere
    table = compare_within_margins(
        problem.measures, margins, problem.tally_names, together, rounds, np.random.default_rng(0), shares_drives=False
    )
    quantities = {
        name: {
            "half_step": one["field"],
            "step": one["simulated"],
            **{key: one[key] for key in ("difference", "interval_90", "margin")},
            "verdict": TOO_FEW if one["verdict"] == OPEN else one["verdict"],
        }
        for name, one in table.items()
    }
    return {
        "step_s": step_s,
        "half_step_s": half_step_s,
        "runs": len(outcomes),
        "num_rounds": len(halved.tally),
        "quantities": quantities,
    }
