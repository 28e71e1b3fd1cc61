"""The search of a calibration as a whole: what the logs say, two stages in the surrogate, finalists in SUMO."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.calibration.confirmation.confirmation import Confirmation, confirm
from jaxcalib.calibration.confirmation.scenario_check import start_scenario_check
from jaxcalib.calibration.stages.budget import Budget, plan_budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.two_stage import TwoStageResult, search_two_stages
from jaxcalib.initial_values.initial_point import InitialPoint, find_initial_point, without_driver_logs
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSumo, JournaledSurrogate
from jaxcalib.runs.seeds import CONFIRMATION_SEED, SEARCH_SEED
from jaxcalib.runs.session import Session
from sim_adapters.jax.simulator import JaxSimulator


def plan_calibration(problem: CalibrationProblem, settings: Settings, scale: float, *, in_sumo: bool = False) -> Budget:
    """Return the numbers of runs of a calibration with the user's options; see `plan_budget`."""
    plan = plan_budget(problem, scale, in_sumo=in_sumo)
    return replace(plan, confirmation_rounds=1) if "correction" in settings.without else plan


@dataclass(frozen=True)
class SearchedValues:
    """What initial values, the two stages and the confirmation in SUMO found.

    Attributes:
        initial: where the search began.
        found: what the two stages found in the surrogate.
        confirmation: what SUMO made of it; its best point is the result.
        surrogate: evaluator of the surrogate on the drives to fit.
    """

    initial: InitialPoint
    found: TwoStageResult
    confirmation: Confirmation
    surrogate: Evaluator

    @property
    def values(self) -> np.ndarray:
        """The result: parameter values in the order of the layout."""
        return self.initial.space.values_of(self.confirmation.best[None])[0]


def search_values(
    problem: CalibrationProblem,
    settings: Settings,
    plan: Budget,
    engine: JaxSimulator | None,
    sumo: JournaledSumo,
    session: Session,
) -> SearchedValues:
    """Search the parameter values of a problem on the drives to fit, and confirm them in SUMO.

    Args:
        problem: the problem.
        settings: the user's options.
        plan: numbers of runs.
        engine: the surrogate; compiled while the logs are fitted. None where SUMO makes the search's runs, too.
        sumo: SUMO.
        session: seeds, journal, progress and time of the command.

    Raises:
        AllRunsFailedError: a simulator failed; where SUMO cannot run the scenario as it is, before the search begins.
    """
    # a run that the final errors need anyway
    check = start_scenario_check(problem, session.first_seed, sumo.start)
    with ThreadPoolExecutor(1) as thread:
        compiled = thread.submit(engine.prepare if engine else lambda: None)  # meanwhile the logs are fitted
        session.progress.stage("initial_values")
        with session.stopwatch.time("initial_values"):
            initial = find_initial_point(problem, settings.scaling_factor, settings.bounds, session.seed)
            if "logs" in settings.without:
                initial = without_driver_logs(initial)
        compiled.result()
    check()
    surrogate = Evaluator(
        JournaledSurrogate(engine, session.journal) if engine else sumo,
        problem.departs_s("fit"),
        session.first_seed + SEARCH_SEED,
        session.progress.surrogate_runs,
        shares_runs=engine is None and problem.template.can_share_runs,
    )
    found = search_two_stages(problem, initial, surrogate, settings, plan, session)
    confirming = Evaluator(
        sumo,
        problem.departs_s("fit"),
        session.first_seed + CONFIRMATION_SEED,
        session.progress.sumo_runs,
        shares_runs=problem.template.can_share_runs,
    )
    with session.stopwatch.time("confirmation"):
        confirmation = confirm(found, initial, surrogate, confirming, plan, session)
    return SearchedValues(initial, found, confirmation, surrogate)
