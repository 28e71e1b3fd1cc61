"""The first stage: parameter values that the drives to fit ask for, by the calibration's own search."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.scenario_runs import start_scenario_runs
from jaxcalib.calibration.value_search import SearchedValues, search_values
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.field.seen_range import seen_perception
from jaxcalib.field.sensor_errors import HONEST
from jaxcalib.problem.engines import finer_surrogate_engine, sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, drives_to_fit, read_problem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSumo

Values = Float[np.ndarray, " parameter"]


@dataclass(frozen=True)
class Calibrated:
    """What the recalibration found."""

    problem: CalibrationProblem  # the problem, with the sensors' range that the drives show
    searched: SearchedValues  # the search

    @property
    def bounds(self) -> tuple[Values, Values]:
        """Least and largest value of each parameter; inflows may lie beyond those that the search looked at."""
        space = self.searched.initial.space
        is_inflow = np.arange(len(space.lower)) < space.layout.num_inputs
        return np.where(is_inflow, 0.0, space.lower), np.where(is_inflow, np.inf, space.upper)


def recalibrate(session: DiagnosisSession) -> Calibrated:
    """Search parameter values without any effect."""
    problem = problem_to_search(session)
    with sumo_engine(problem, workers=session.sumo_workers) as pool:
        sumo, engine = JournaledSumo(pool, session.journal), surrogate_engine(problem)
        plan = session.calibration
        waiting = start_scenario_runs(problem, sumo, plan, session, shares_runs=problem.template.can_share_runs)
        searched = search_values(
            problem, Settings(), plan, engine, sumo, session, waiting, finer=lambda: finer_surrogate_engine(problem)
        )
    return Calibrated(problem, searched)


def problem_to_search(session: DiagnosisSession) -> CalibrationProblem:
    """Return the problem with the sensors' range that the drives show, less what sensors got wrong.

    What sensors do must not bend the values: it is an effect of its own, to be found in the drives as they are.
    """
    problem = session.problem
    is_short = seen_perception(drives_to_fit(problem.drives), problem.case.perception) != problem.case.perception
    if is_short or problem.sensor_errors != HONEST:
        return read_problem(problem.case.folder)
    return problem
