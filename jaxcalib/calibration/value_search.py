"""The search of a calibration as a whole: what the logs say, two stages in the surrogate, finalists in SUMO."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.calibration.budget import Budget, plan_budget
from jaxcalib.calibration.confirmation import Confirmation, confirm
from jaxcalib.calibration.evaluator import Evaluator
from jaxcalib.calibration.scenario_check import start_scenario_check
from jaxcalib.calibration.seeds import CONFIRMATION_SEED, SEARCH_SEED, SEEDS_PER_CALIBRATION
from jaxcalib.calibration.two_stage import TwoStageResult, search_two_stages
from jaxcalib.initial_values.initial_point import InitialPoint, find_initial_point, without_driver_logs
from jaxcalib.journal import Journal, JournaledSumo, JournaledSurrogate
from jaxcalib.problem import CalibrationProblem
from jaxcalib.progress import Progress
from jaxcalib.settings import Settings
from jaxcalib.stopwatch import Stopwatch
from sim_adapters.jax_simulator import JaxSimulator


def plan_calibration(problem: CalibrationProblem, settings: Settings, scale: float) -> Budget:
    """Return the numbers of runs of a calibration with the user's options; see `plan_budget`."""
    plan = plan_budget(problem, scale)
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
    seed: int,
    engine: JaxSimulator,
    sumo: JournaledSumo,
    journal: Journal,
    progress: Progress,
    stopwatch: Stopwatch,
) -> SearchedValues:
    """Search the parameter values of a problem on the drives to fit, and confirm them in SUMO.

    Args:
        problem: the problem.
        settings: the user's options.
        plan: numbers of runs.
        seed: of all random numbers.
        engine: the surrogate; compiled while the logs are fitted.
        sumo: SUMO.
        journal: of the runs made.
        progress: told of each stage.
        stopwatch: takes the time of each part.

    Raises:
        AllRunsFailedError: a simulator failed; where SUMO cannot run the scenario as it is, before the search begins.
    """
    first_seed = seed * SEEDS_PER_CALIBRATION
    check = start_scenario_check(problem, first_seed, sumo.start)  # a run that the final errors need anyway
    with ThreadPoolExecutor(1) as thread:
        compiled = thread.submit(engine.prepare)  # meanwhile the logs are fitted
        progress.stage("initial_values")
        with stopwatch.time("initial_values"):
            initial = find_initial_point(problem, settings.scaling_factor, settings.bounds, seed)
            if "logs" in settings.without:
                initial = without_driver_logs(initial)
        compiled.result()
    check()
    surrogate = Evaluator(
        JournaledSurrogate(engine, journal), problem.departs_s("fit"), first_seed + SEARCH_SEED, progress.surrogate_runs
    )
    found = search_two_stages(problem, initial, surrogate, settings, plan, seed, progress, journal.clock)
    for name, wall_s in found.wall_s.items():
        stopwatch.add(name, wall_s)
    confirming = Evaluator(
        sumo,
        problem.departs_s("fit"),
        first_seed + CONFIRMATION_SEED,
        progress.sumo_runs,
        shares_runs=problem.template.can_share_runs,
    )
    with stopwatch.time("confirmation"):
        confirmation = confirm(
            found, initial, surrogate, confirming, plan, progress, lambda: stopwatch.start("corrected_search")
        )
    return SearchedValues(initial, found, confirmation, surrogate)
