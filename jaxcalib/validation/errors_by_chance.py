"""The errors of Eqs. 23-36, with intervals, beside those that simulated drives show against one another."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.calibration.confirmation.final_errors import FinalRuns, final_errors
from jaxcalib.calibration.objective.accuracy import VEHICLE_LEVEL_SUM, Effectiveness, noise_floor, vehicle_level_of
from jaxcalib.calibration.result.result import rounded
from jaxcalib.case.case import Role
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.validation.comparison import Table
from jaxcalib.validation.observer import ObservedDrives
from sim_adapters.interface import RunOutcome

NUM_DRAWS = 1000  # of field-like sets


def error_table(
    problem: CalibrationProblem, role: Role, simulated: ObservedDrives, outcomes: Sequence[RunOutcome]
) -> Table:
    """Return each error with its 90 % interval, and what chance alone makes.

    They are no tests of their own: each is the difference of a measure that is tested.
    """
    num_rounds, num_drives, num_tallies = simulated.tally.shape
    runs = FinalRuns(
        simulated.tally.reshape(-1, num_tallies), np.tile(np.arange(num_drives), num_rounds), tuple(outcomes)
    )
    errors = final_errors(problem, role, runs, None)
    if errors is None:
        return {}
    draws = noise_floor(problem.measures, problem.tally_names, runs.tally, runs.drive, NUM_DRAWS)
    table: Table = {}
    for name in [*errors.pooled.errors, VEHICLE_LEVEL_SUM]:
        by_chance = _by_chance(draws, name, errors.pooled)
        value = errors.error(name)
        is_known = value is not None and len(by_chance) > 0
        table[name] = {
            "value": rounded(value),
            "interval_90": errors.interval[name],
            "among_simulated": rounded(float(by_chance.mean())) if is_known else None,
            "limit": rounded(float(np.quantile(by_chance, 0.95))) if is_known else None,
        }
    return table


def _by_chance(draws: Sequence[Effectiveness], name: str, seen: Effectiveness) -> np.ndarray:
    if name == VEHICLE_LEVEL_SUM:
        return np.asarray(vehicle_level_of(draws, seen), float)
    return np.asarray([error for draw in draws if (error := draw.errors[name]) is not None], float)
