"""Where a search begins: what the logs say of drivers and inflows, with a first look at both simulators."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.confirmation.final_errors import FinalRuns
from jaxcalib.calibration.first_look import FirstLook
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.initial_values.initial_point import InitialPoint, find_initial_point, without_driver_logs
from jaxcalib.problem.engines import DECISION_INTERVAL_S, FINER_DECISION_INTERVAL_S
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSumo, JournaledSurrogate
from jaxcalib.runs.seeds import SEARCH_SEED
from jaxcalib.runs.session import Session
from sim_adapters.jax.simulator import JaxSimulator


@dataclass(frozen=True)
class FirstValues:
    """What the logs say, and what was run to read them."""

    initial: InitialPoint  # values with their errors
    look: FirstLook  # both simulators at the scenario's demand
    usual: Evaluator | None  # the surrogate that was asked first; None where there is none
    in_sumo: Evaluator  # SUMO, on the drives to fit

    @property
    def decision_interval_s(self) -> float:
        """Time between two decisions of the surrogate that stays."""
        return DECISION_INTERVAL_S if self.look.surrogate is self.usual else FINER_DECISION_INTERVAL_S

    @property
    def num_surrogate_runs(self) -> int:
        """Runs of all surrogates on the drives to fit, so far."""
        return sum(one.num_runs for one in {self.usual, self.look.surrogate} if one is not None)


def find_first_values(
    problem: CalibrationProblem,
    settings: Settings,
    plan: Budget,
    engine: JaxSimulator | None,
    sumo: JournaledSumo,
    session: Session,
    scenario_runs: Callable[[], FinalRuns],
    finer: Callable[[], JaxSimulator | None] = lambda: None,
) -> FirstValues:
    """Return what the logs say of the parameters; for arguments and errors see `search_values`."""
    in_sumo = sumo_evaluator(problem, sumo, session, SEARCH_SEED)
    usual = None if engine is None else surrogate_evaluator(problem, engine, session)

    def with_finer_decisions() -> Evaluator | None:
        other = finer()
        return None if other is None else surrogate_evaluator(problem, other, session)

    look = FirstLook(problem, usual, in_sumo, plan, session, scenario_runs, with_finer_decisions)
    with ThreadPoolExecutor(1) as thread:
        compiled = thread.submit(engine.prepare if engine else lambda: None)  # meanwhile the logs are fitted

        def tallies_with(values: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, "run tally"]:
            compiled.result()
            return look.tallies_with(values)

        session.progress.stage("initial_values")
        with session.stopwatch.time("initial_values"):
            initial = find_initial_point(problem, settings.scaling_factor, settings.bounds, session.seed, tallies_with)
            if "logs" in settings.without:
                initial = without_driver_logs(initial)
    return FirstValues(initial, look, usual, in_sumo)


def sumo_evaluator(
    problem: CalibrationProblem, sumo: JournaledSumo, session: Session, seeds_from: int, *, may_fail: bool = False
) -> Evaluator:
    """Return what evaluates candidates in SUMO on the drives to fit.

    Args:
        problem: the problem.
        sumo: SUMO.
        session: gives the seeds, and is told of each run.
        seeds_from: the first of the calibration's seeds.
        may_fail: whether a first evaluation of which no run succeeds is an answer, rather than an AllRunsFailedError.
    """
    return Evaluator(
        sumo,
        problem.drive_starts("fit"),
        session.first_seed + seeds_from,
        session.progress.sumo_runs,
        shares_runs=problem.template.can_share_runs,
        num_tallies=len(problem.tally_names) if may_fail else 0,
    )


def surrogate_evaluator(problem: CalibrationProblem, engine: JaxSimulator, session: Session) -> Evaluator:
    """Return what evaluates candidates in the surrogate on the drives to fit."""
    return Evaluator(
        JournaledSurrogate(engine, session.journal),
        problem.drive_starts("fit"),
        session.first_seed + SEARCH_SEED,
        session.progress.surrogate_runs,
    )
