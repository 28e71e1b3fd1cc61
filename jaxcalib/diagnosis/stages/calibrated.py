"""The first stage: parameter values that the drives to fit show by themselves.

A calibration goes on from there to what makes the traffic fit. Where something is missing in the simulation, that bends
the values to make up for it: demand by a third, lane-change parameters by factors, where pairs of leader and follower,
accepted gaps and counts had told them to a few per cent. So the null of a diagnosis is what these say, and what they
leave open is open in the judgement.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.first_values import find_first_values
from jaxcalib.calibration.scenario_runs import start_scenario_runs
from jaxcalib.calibration.stages.search_box import half_width_of, search_box
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.field.seen_range import seen_perception
from jaxcalib.field.sensor_errors import HONEST
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.problem.engines import finer_surrogate_engine, sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, drives_to_fit, read_problem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSumo

Values = Float[np.ndarray, " parameter"]


@dataclass(frozen=True)
class Calibrated:
    """What the drives show of the parameters."""

    initial: InitialPoint  # values with their errors
    decision_interval_s: float  # of the surrogate that drives as SUMO does
    num_surrogate_runs: int
    num_sumo_runs: int

    @property
    def values(self) -> Values:
        """Parameter values in the order of the layout."""
        return self.initial.values

    @property
    def error(self) -> Values:
        """Standard error of each; inf where the drives are silent."""
        space, error = self.initial.space, self.initial.unit_error
        unit, known = space.unit_of(self.initial.values), np.isfinite(error)
        beside = np.where(known, error, 0.0) * np.where(unit > 0.5, -1.0, 1.0)
        return np.where(known, np.abs(space.values_of((unit + beside)[None])[0] - self.initial.values), np.inf)

    @property
    def bounds(self) -> tuple[Values, Values]:
        """Least and largest value of each parameter that the drives leave open: where a search would look."""
        space = self.initial.space
        unit = space.unit_of(self.initial.values)
        box = search_box(unit, range(len(unit)), half_width_of(self.initial.unit_error))
        low, high = space.values_of(np.stack([box.lower, box.upper]))
        return low, high


def calibrate_by_logs(session: DiagnosisSession) -> Calibrated:
    """Read parameter values off the drives to fit, and look at both simulators there."""
    problem = problem_to_read(session)
    with sumo_engine(problem, workers=session.sumo_workers) as pool:
        sumo, engine = JournaledSumo(pool, session.journal), surrogate_engine(problem)
        plan = session.calibration
        waiting = start_scenario_runs(problem, sumo, plan, session, shares_runs=problem.template.can_share_runs)
        first = find_first_values(
            problem, Settings(), plan, engine, sumo, session, waiting, lambda: finer_surrogate_engine(problem)
        )
    return Calibrated(first.initial, first.decision_interval_s, first.num_surrogate_runs, first.in_sumo.num_runs)


def problem_to_read(session: DiagnosisSession) -> CalibrationProblem:
    """Return the problem with the sensors' range that the drives show, less what sensors got wrong.

    What sensors do must not bend the values: it is an effect of its own, to be found in the drives as they are.
    """
    problem = session.problem
    is_short = seen_perception(drives_to_fit(problem.drives), problem.case.perception) != problem.case.perception
    if is_short or problem.sensor_errors != HONEST:
        return read_problem(problem.case.folder)
    return problem
