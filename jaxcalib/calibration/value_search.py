"""The search of a calibration as a whole: what the logs say, two stages in the surrogate, finalists in SUMO.

Where the surrogate drives unlike SUMO, SUMO makes the search's runs.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.calibration.confirmation.agreement import Agreement, compare_sections
from jaxcalib.calibration.confirmation.confirmation import Confirmation, Finals, confirm
from jaxcalib.calibration.confirmation.final_errors import FinalRuns
from jaxcalib.calibration.confirmation.search_on import leaves_more_than_noise, search_on_in_sumo
from jaxcalib.calibration.confirmation.space_mapping import can_be_mapped, search_mapped
from jaxcalib.calibration.first_values import find_first_values, sumo_evaluator
from jaxcalib.calibration.stages.budget import (
    Budget,
    in_sumo_alone,
    plan_budget,
    runs_of_polish,
    with_mapping,
)
from jaxcalib.calibration.stages.two_stage import TwoStageResult, search_two_stages
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.problem.engines import DECISION_INTERVAL_S
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSumo
from jaxcalib.runs.seeds import CONFIRMATION_SEED
from jaxcalib.runs.session import Session
from sim_adapters.jax.simulator import JaxSimulator


def plan_calibration(problem: CalibrationProblem, settings: Settings, scale: float, *, in_sumo: bool = False) -> Budget:
    """Return the numbers of runs of a calibration with the user's options; see `plan_budget`."""
    plan = plan_budget(problem, scale, in_sumo=in_sumo)
    return replace(plan, confirmation_rounds=1, most_mappings=0) if "correction" in settings.without else plan


@dataclass(frozen=True)
class SearchedValues:
    """What initial values, the two stages and the confirmation in SUMO found."""

    plan: Budget  # numbers of runs, of where the search was made
    initial: InitialPoint  # where the search began
    found: TwoStageResult  # what the two stages found
    confirmation: Confirmation  # what SUMO made of it; its best point is the result
    # surrogate against SUMO, at the scenario's values and at those that the search found; none where the
    # surrogate was not asked
    agreements: tuple[Agreement, ...]
    is_in_sumo: bool  # whether SUMO made the search's runs
    num_surrogate_runs: int  # on the drives to fit
    num_sumo_search_runs: int  # drives of the search in SUMO, apart from those that confirm
    warnings: tuple[str, ...]  # what the runs of the scenario as it is showed, one line each
    decision_interval_s: float = DECISION_INTERVAL_S  # of the surrogate that was asked

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
    scenario_runs: Callable[[], FinalRuns],
    *,
    may_leave_surrogate: bool = False,
    finer: Callable[[], JaxSimulator | None] = lambda: None,
) -> SearchedValues:
    """Search the parameter values of a problem on the drives to fit, and confirm them in SUMO.

    Args:
        problem: the problem.
        settings: the user's options.
        plan: numbers of runs.
        engine: the surrogate; compiled while the logs are fitted. None where SUMO makes the search's runs, too.
        sumo: SUMO.
        session: seeds, journal, progress and time of the command.
        scenario_runs: waits for SUMO's runs of the scenario as it is; see `start_scenario_runs`.
        may_leave_surrogate: whether SUMO makes the search's runs where the surrogate does not drive as it does.
        finer: returns a surrogate with more frequent decisions, which is tried before that.

    Raises:
        AllRunsFailedError: a simulator failed; where SUMO cannot run the scenario as it is, before the search begins.
    """
    first = find_first_values(problem, settings, plan, engine, sumo, session, scenario_runs, finer)
    initial, look, usual, in_sumo = first.initial, first.look, first.usual, first.in_sumo
    agreements, surrogate = look.agreements, look.surrogate
    is_in_sumo = surrogate is None or (may_leave_surrogate and not look.agrees)
    if is_in_sumo and surrogate is not None:
        plan = in_sumo_alone(plan, problem, plan.scale)
        session.progress.plan(plan.num_surrogate_runs, plan.num_sumo_runs)
    if any(not agreement.holds for agreement in agreements):
        stays = (
            "so the surrogate decides more often" if surrogate is not usual else "so the search stays in the surrogate"
        )
        where = "so SUMO makes the search's runs" if is_in_sumo else stays
        session.progress.notes([*map(str, agreements[:-1]), f"{agreements[-1]}; {where}."])
    evaluator = in_sumo if is_in_sumo or surrogate is None else surrogate
    found = search_two_stages(problem, initial, evaluator, settings, plan, session)
    confirming = sumo_evaluator(problem, sumo, session, CONFIRMATION_SEED, may_fail=True)
    with session.stopwatch.time("confirmation"):
        confirmation = confirm(found, initial, evaluator, confirming, plan, session)
        if not is_in_sumo:
            agreement = _agreement_of_result(problem, confirmation, "at the values found")
            agreements.append(agreement)
            if may_leave_surrogate and not agreement.holds:
                session.progress.notes([f"{agreement}; so the search goes on with SUMO."])
                going_on = with_mapping(plan, problem) if can_be_mapped(confirmation) else plan
                session.progress.plan(going_on.num_surrogate_runs, going_on.num_sumo_runs)
                finals = Finals(initial.space, evaluator, confirming, plan, session)
                confirmation = search_mapped(confirmation, found, finals)
                if leaves_more_than_noise(confirmation):
                    in_sumo_plan = in_sumo_alone(plan, problem, plan.scale)
                    polishing = in_sumo_plan.most_polishes * runs_of_polish(in_sumo_plan, problem)
                    num_sumo_runs = going_on.num_sumo_runs + polishing + plan.confirmation_runs
                    session.progress.plan(going_on.num_surrogate_runs, num_sumo_runs)
                    confirmation = search_on_in_sumo(confirmation, found, in_sumo, finals, in_sumo_plan)
                if confirmation.went_on_by:
                    agreements.append(_agreement_of_result(problem, confirmation, "at the values found with SUMO"))
    return SearchedValues(
        plan=plan,
        initial=initial,
        found=found,
        confirmation=confirmation,
        agreements=tuple(agreements),
        is_in_sumo=is_in_sumo,
        num_surrogate_runs=first.num_surrogate_runs,
        num_sumo_search_runs=in_sumo.num_runs,
        warnings=tuple(look.warnings),
        decision_interval_s=first.decision_interval_s,
    )


def _agreement_of_result(problem: CalibrationProblem, confirmation: Confirmation, where: str) -> Agreement:
    """Compare both simulators at the values that the search found."""
    in_surrogate = confirmation.confirmed[confirmation.winner].surrogate
    in_sumo = confirmation.finalists[confirmation.winner].tallies
    return compare_sections(problem, in_surrogate, in_sumo, where)
