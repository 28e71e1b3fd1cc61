"""How much of the demand gets onto the road, entrance by entrance, below and beyond what fits."""

from typing import Any

import numpy as np

from experiments.fidelity.transfer import SPARE_CAPACITY
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.problem.engines import sumo_engine, surrogate_engine
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem

SHARES = (0.6, 0.75, 0.9, 1.0, 1.1, 1.2, 1.3)  # of each input's capacity
NUM_RUNS = 8
BEYOND_CAPACITY = 6.0  # times the scenario's inflow


def insertion_table(problem: CalibrationProblem) -> list[dict[str, Any]]:
    """Return the shares of vehicles that enter in both simulators at 60 to 130 % of the capacity of each input.

    The capacity of an input is what SUMO inserts where far more is scheduled, the others as in the scenario.
    """
    base = problem.template.base_values()
    starts = problem.drive_starts("fit")
    surrogate = Evaluator(surrogate_engine(problem, SPARE_CAPACITY), starts, 0)
    rows: list[dict[str, Any]] = []
    with sumo_engine(problem) as pool:
        sumo = Evaluator(pool, starts, 0)
        num_runs = sumo.rounds_of(NUM_RUNS)
        for number, name in enumerate(problem.layout.input_ids):
            crowded = base.copy()
            crowded[number] *= BEYOND_CAPACITY
            capacity_vehph = crowded[number] * _inserted_share(sumo, crowded, num_runs, number)
            for share in SHARES:
                values = base.copy()
                values[number] = share * capacity_vehph
                rows.append(
                    {
                        "input": name,
                        "capacity_vehph": capacity_vehph,
                        "share_of_capacity": share,
                        "demand_vehph": values[number],
                        "sumo_share": _inserted_share(sumo, values, num_runs, number),
                        "surrogate_share": _inserted_share(surrogate, values, num_runs, number),
                    }
                )
    return rows


def _inserted_share(evaluator: Evaluator, values: np.ndarray, num_runs: int, number: int) -> float:
    (outcomes,) = evaluator.evaluate(round_values(values)[None], num_runs).outcomes
    arrived = sum(float(outcome.num_arrived[number]) for outcome in outcomes if outcome.status.is_ok)
    inserted = sum(float(outcome.num_inserted[number]) for outcome in outcomes if outcome.status.is_ok)
    return inserted / arrived if arrived else float("nan")
