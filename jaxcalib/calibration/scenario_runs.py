"""SUMO's runs of the scenario as it is, made before any search and needed for the errors before calibration anyway.

They say whether SUMO can run the scenario, what drives see where the demand is known, and how near the surrogate comes.
"""

from collections.abc import Callable

from jaxcalib.calibration.confirmation.final_errors import FinalRuns, start_final_runs
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.check.scenario_check import WORTH_SAYING
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.journal import JournaledSumo
from jaxcalib.runs.session import Session
from sim_adapters.interface import Status


def start_scenario_runs(
    problem: CalibrationProblem, sumo: JournaledSumo, plan: Budget, session: Session, *, shares_runs: bool = False
) -> Callable[[], FinalRuns]:
    """Start the runs of the scenario's own values on the drives to fit; return what waits for them.

    Args:
        problem: the problem.
        sumo: SUMO.
        plan: numbers of runs.
        session: gives the seeds, and is told of each run.
        shares_runs: whether drives may share a run; those of the final errors do not.

    Returns:
        What waits for the runs, and raises an AllRunsFailedError if none of them succeeds.
    """
    values = round_values(problem.template.base_values())
    wait = start_final_runs(problem, sumo, values, "fit", plan.final_fit_runs, session, shares_runs=shares_runs)

    def finish() -> FinalRuns:
        try:
            return wait()
        except AllRunsFailedError as error:
            raise AllRunsFailedError(f"SUMO cannot run the scenario as it is: {error}", error.log_tail) from None

    return finish


def scenario_warnings(runs: FinalRuns) -> list[str]:
    """Return one line for what a user should know before the search: a subject vehicle that stays outside or under way.

    Args:
        runs: of the scenario's own values.
    """
    outcomes, lines = runs.outcomes, []
    missing = sum(outcome.status is Status.SUBJECT_MISSING for outcome in outcomes)
    if missing:
        lines.append(
            f"the subject vehicle never entered in {missing} of {len(outcomes)} SUMO runs of the scenario as it is: no "
            "room where and when it departs (depart, departLane, departPos, departSpeed), or a full entrance."
        )
    late = sum(outcome.status.is_ok and not outcome.subject_left for outcome in outcomes)
    if late:
        lines.append(
            f"the subject vehicle had not arrived by the end in {late} of {len(outcomes)} SUMO runs of the scenario as "
            "it is; what lies beyond is not matched. Raise scenario.duration_s if its drive should be whole."
        )
    backlog = max((outcome.backlog_share for outcome in outcomes if outcome.status.is_ok), default=0.0)
    if backlog > WORTH_SAYING:
        lines.append(
            f"{100 * backlog:.0f}% of the scenario's vehicles had not entered by the end of a SUMO run: more than its "
            "lanes carry. Inflows beyond that change nothing, and cannot be found."
        )
    return lines
