"""What both simulators show at the scenario's demand before any search: whether they agree, and what drives see there.

They are compared at the scenario's own values and, where they do not agree there, with the drivers that the logs show:
there the search begins, and a road that jams with the scenario's drivers may not jam with real ones. A surrogate that
still differs may agree with more frequent decisions.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.confirmation.agreement import Agreement, compare_sections
from jaxcalib.calibration.confirmation.final_errors import FinalRuns
from jaxcalib.calibration.scenario_runs import scenario_warnings
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.seeds import NOISE_OFFSET
from jaxcalib.runs.session import Session

AGREEMENT = "agreement"  # these runs, for the times
IN_SCENARIO = "at the scenario's values"
WITH_LOGGED_DRIVERS = "at the scenario's demand with the logs' drivers"
WITH_FINER_DECISIONS = f"{WITH_LOGGED_DRIVERS} and more frequent decisions"

Tallies = Float[np.ndarray, "run tally"]


class FirstLook:
    """Runs at the scenario's demand.

    Attributes:
        agreements: surrogate against SUMO, in the order in which they were compared.
        agrees: whether the surrogate may make the search's runs.
        surrogate: the one that may, or else the usual one; None where there is none.
        warnings: what a user should know of the scenario's runs, one line each.
    """

    def __init__(
        self,
        problem: CalibrationProblem,
        surrogate: Evaluator | None,
        sumo: Evaluator,
        plan: Budget,
        session: Session,
        scenario_runs: Callable[[], FinalRuns],
        finer: Callable[[], Evaluator | None] = lambda: None,
    ) -> None:
        """Keep what is needed for the runs.

        Args:
            problem: the problem.
            surrogate: on the drives to fit; None where SUMO makes the search's runs.
            sumo: the same.
            plan: numbers of runs.
            session: is told of the runs and their time.
            scenario_runs: waits for SUMO's runs of the scenario as it is.
            finer: returns a surrogate with more frequent decisions, if there can be one.
        """
        self._problem, self.surrogate, self._sumo, self._finer = problem, surrogate, sumo, finer
        self._plan, self._session, self._scenario_runs = plan, session, scenario_runs
        self.agreements: list[Agreement] = []
        self.agrees = surrogate is not None
        self._has_looked = False
        self.warnings: list[str] = []

    def tallies_with(self, values: Float[np.ndarray, " parameter"]) -> Tallies:
        """What the drives to fit see with the drivers of the logs, at the scenario's demand first.

        Where both simulators drive alike, many runs of the surrogate say it with less chance than few of SUMO.

        Args:
            values: all parameters; the first time, with the inputs as in the scenario.
        """
        if self._has_looked:
            with self._session.stopwatch.time(AGREEMENT):
                return self._in_chosen_simulator(values)
        self._has_looked = True
        in_scenario = self._scenario_runs()
        self.warnings += scenario_warnings(in_scenario)
        self._session.progress.notes(self.warnings)
        with self._session.stopwatch.time(AGREEMENT):
            tallies = self._compared(values, in_scenario.tally)
        return tallies if len(tallies) else in_scenario.tally

    def _compared(self, values: Float[np.ndarray, " parameter"], in_scenario: Tallies) -> Tallies:
        problem, sumo, plan = self._problem, self._sumo, self._plan
        num_sumo_runs = sumo.rounds_of(plan.confirmation_runs)
        if self.surrogate is None or not len(in_scenario):
            return successful_tallies(problem, sumo, values, num_sumo_runs)
        num_runs = self._num_runs(self.surrogate)
        as_it_is = round_values(problem.template.base_values())
        ours = successful_tallies(problem, self.surrogate, as_it_is, num_runs)
        first = compare_sections(problem, ours.sum(axis=0), in_scenario, IN_SCENARIO)
        self.agreements.append(first)
        ours = successful_tallies(problem, self.surrogate, values, num_runs)
        if first.holds:
            return ours
        theirs = successful_tallies(problem, sumo, values, num_sumo_runs)
        if not len(theirs):
            self.agrees = False
            return theirs
        self.agreements.append(compare_sections(problem, ours.sum(axis=0), theirs, WITH_LOGGED_DRIVERS))
        if not self.agreements[-1].holds and (finer := self._finer()) is not None:
            ours = successful_tallies(problem, finer, values, num_runs)
            self.agreements.append(compare_sections(problem, ours.sum(axis=0), theirs, WITH_FINER_DECISIONS))
            self.surrogate = finer if self.agreements[-1].holds else self.surrogate
        self.agrees = self.agreements[-1].holds
        return ours if self.agrees else theirs

    def _in_chosen_simulator(self, values: Float[np.ndarray, " parameter"]) -> Tallies:
        if self.surrogate is not None and self.agrees:
            return successful_tallies(self._problem, self.surrogate, values, self._num_runs(self.surrogate))
        num_runs = self._sumo.rounds_of(self._plan.confirmation_runs)
        return successful_tallies(self._problem, self._sumo, values, num_runs)

    def _num_runs(self, surrogate: Evaluator) -> int:
        return surrogate.rounds_of(self._plan.noise_runs // 2)


def successful_tallies(
    problem: CalibrationProblem, evaluator: Evaluator, values: Float[np.ndarray, " parameter"], num_runs: int
) -> Tallies:
    """Tallies of a candidate's runs that succeeded; none where all fail: such a simulator agrees with nobody."""
    try:
        runs = evaluator.evaluate(values[None], num_runs, NOISE_OFFSET).tally[0]
    except AllRunsFailedError:
        return np.zeros((0, len(problem.tally_names)))
    return runs[np.isfinite(runs).all(axis=1)]
