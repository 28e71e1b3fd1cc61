"""What a sweep is made from, ready before its first run."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from jaxcalib.problem.engines import prepare_devices
from jaxcalib.problem.parameter_space import ParameterSpace, parameter_space, round_values
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.problem.settings import Settings, naming, read_settings
from jaxcalib.runs.drives_in_turn import interleaved
from jaxcalib.runs.run_folder import identify
from jaxcalib.runs.seeds import SEEDS_PER_CALIBRATION
from jaxcalib.sweeps.columns import rows_of, sweep_schema
from jaxcalib.sweeps.description import describe, identity_options
from jaxcalib.sweeps.design import make_design
from jaxcalib.sweeps.options import SweepOptions
from jaxcalib.sweeps.plan import SweepPlan
from sim_adapters.interface import RunOutcome


@dataclass(frozen=True)
class PreparedSweep:
    """A sweep before its first run."""

    problem: CalibrationProblem  # the case with its scenario and logs
    space: ParameterSpace  # the parameters
    settings: Settings  # for their bounds
    plan: SweepPlan  # which runs there are
    schema: pa.Schema  # columns of the table
    identity: dict[str, str]  # what rows depend on

    def description(self) -> dict[str, Any]:
        """Return what is written down of the sweep when it begins."""
        return describe(self.problem, self.space, self.plan, self.settings, self.schema, self.identity)

    def rows(self, block: int, outcomes: Sequence[RunOutcome]) -> pa.Table:
        """Return the rows that the outcomes of a block become."""
        of, plan = self.problem, self.plan
        return rows_of(
            self.schema, self.space, of.measures, of.tally_names, plan.engine, plan.candidates(block), outcomes
        )


def prepare_sweep(case: Path | str, options: SweepOptions) -> PreparedSweep:
    """Read a case and lay out the runs of a sweep.

    Raises:
        CaseError: the case, the design or the settings are wrong.
    """
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    settings = options.settings if isinstance(options.settings, Settings) else read_settings(options.settings)
    with naming(options.settings):
        space = _space(problem, settings)
    base = round_values(problem.template.base_values())
    plan = SweepPlan(
        engine=options.engine,
        design=make_design(options.design, space, base, options.parameters, options.seed),
        num_seeds=options.seeds,
        first_seed=options.seed * SEEDS_PER_CALIBRATION,
        starts=tuple(interleaved(problem.drive_starts("fit"))),
    )
    schema = sweep_schema(space, problem.measures)
    return PreparedSweep(
        problem, space, settings, plan, schema, identify(problem.case, identity_options(plan, settings))
    )


def _space(problem: CalibrationProblem, settings: Settings) -> ParameterSpace:
    """Return the bounds: inflows around the scenario's, driver parameters as in calibrations."""
    demand = problem.template.base_demand_vehph()
    return parameter_space(
        problem.layout, problem.model, np.asarray(demand, float), settings.scaling_factor, settings.bounds
    )
