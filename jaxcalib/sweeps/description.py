"""What is written down of a sweep: in the metadata of its table, and as sweep.json while it goes on."""

import hashlib
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa

from jaxcalib.problem.parameter_space import ParameterSpace
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.provenance import commit, versions
from jaxcalib.sweeps.columns import parameter_columns
from jaxcalib.sweeps.plan import SweepPlan

FORMAT = 1


def identity_options(plan: SweepPlan, settings: Settings) -> dict[str, Any]:
    """Return the options that rows depend on."""
    values = np.ascontiguousarray(plan.design.values, np.float64)
    return {
        "sweep_format": FORMAT,
        "engine": plan.engine,
        "design": plan.design.name,
        "parameters": list(plan.design.varied),
        "candidates": hashlib.sha256(values.tobytes()).hexdigest()[:16],
        "seeds": plan.num_seeds,
        "first_seed": plan.first_seed,
        "scaling_factor": settings.scaling_factor,
        "bounds": settings.bounds,
    }


def describe(
    problem: CalibrationProblem,
    space: ParameterSpace,
    plan: SweepPlan,
    settings: Settings,
    schema: pa.Schema,
    identity: dict[str, str],
) -> dict[str, Any]:
    """Return what is written down of a sweep when it begins."""
    columns = parameter_columns(space)
    base = plan.design.values[0]
    return {
        "format": FORMAT,
        "case": problem.case.name,
        "engine": plan.engine,
        "design": plan.design.name,
        "num_candidates": len(plan.design.values),
        "num_seeds": plan.num_seeds,
        "num_rows": plan.num_rows,
        "num_blocks": plan.num_blocks,
        "block_rows": plan.block_rows,
        "seeds": [plan.first_seed, plan.first_seed + plan.num_seeds - 1],
        "departs_s": [one.depart_s for one in plan.starts],
        "parameters": {
            name: {
                "column": columns[name],
                "unit": one.unit,
                "varied": name in plan.design.varied,
                **(
                    {"lower": float(one.lower), "upper": float(one.upper), "logarithmic": one.is_logarithmic}
                    if name in plan.design.varied
                    else {"value": float(base[space.index(name)])}
                ),
            }
            for name, one in zip(space.names, space.ranges, strict=True)
        },
        "settings": {"scaling_factor": settings.scaling_factor, "bounds": settings.bounds},
        "columns": {
            field.name: (field.metadata or {}).get(b"description", b"").decode()
            for field in schema
            if not field.name.startswith("num_observations_")
        },
        "versions": versions("scipy", "pyarrow"),
        "commit": commit(),
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
        "warnings": [*plan.design.warnings, *problem.warnings()],
        "identity": identity,
    }
