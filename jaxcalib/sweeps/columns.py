"""Columns of a sweep's table, and the rows that outcomes of runs become."""

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError, shorten
from jaxcalib.measures.measure import Measure
from jaxcalib.problem.parameter_space import ParameterSpace
from sim_adapters.interface import NO_DRIVE, RunOutcome

UNIT_SUFFIX = {"veh/h": "_vehph", "s": "_s", "m": "_m", "m/s": "_mps", "m/s2": "_mps2"}  # others have none
OBSERVATIONS = "num_observations_"  # before the name of a measure
LONGEST_LOG = 500
FIRST_COLUMNS = {
    "candidate": (pa.int32(), "number of the parameter set in the design, from 0"),
    "engine": (pa.dictionary(pa.int8(), pa.string()), "simulator: surrogate or sumo"),
    "seed": (pa.int64(), "seed of the run; the same seeds for every candidate"),
    "depart_s": (pa.float64(), "when the subject vehicle departs; runs take the drives' departures in turn"),
    "drive": (pa.int32(), "number, from 0, of its drive among those with rows, if it tells more than depart_s"),
}
STATUS_COLUMNS = {
    "status": (pa.dictionary(pa.int8(), pa.string()), "OK, or why the run must not be used"),
    "num_collisions": (pa.int32(), "vehicle steps with overlap"),
    "num_teleports": (pa.int32(), "vehicles that the simulator removed"),
    "num_arrived": (pa.int32(), "vehicles that asked to enter"),
    "num_inserted": (pa.int32(), "vehicles that entered"),
    "backlog_share": (pa.float32(), "share of the demand that had not entered by the end"),
    "num_vehicle_steps": (pa.int64(), "vehicles on the road, summed over steps"),
    "subject_left": (pa.bool_(), "whether the subject vehicle reached its destination"),
    "wall_s": (pa.float32(), "computing time of the run; that of its batch, shared out, in the surrogate"),
    "log_tail": (pa.string(), "the simulator's last words if it failed"),
}


def parameter_columns(space: ParameterSpace) -> dict[str, str]:
    """Return the column of each parameter: its name with its unit as suffix."""
    return {name: name + UNIT_SUFFIX.get(one.unit, "") for name, one in zip(space.names, space.ranges, strict=True)}


def sweep_schema(space: ParameterSpace, measures: Mapping[str, Measure]) -> pa.Schema:
    """Return the columns of a sweep's table; each field says unit and meaning in its metadata.

    Raises:
        CaseError: the id of an input is the name of another column.
    """
    fields = [pa.field(name, kind, metadata={"description": text}) for name, (kind, text) in FIRST_COLUMNS.items()]
    for (name, column), one in zip(parameter_columns(space).items(), space.ranges, strict=True):
        fields.append(pa.field(column, pa.float64(), metadata={"description": f"parameter {name}", "unit": one.unit}))
    fields += [pa.field(name, kind, metadata={"description": text}) for name, (kind, text) in STATUS_COLUMNS.items()]
    for measure in measures.values():
        fields.append(pa.field(measure.name, pa.float32(), metadata={"description": measure.description}))
    for name in measures:
        text = f"observations that {name} rests on"
        fields.append(pa.field(OBSERVATIONS + name, pa.float32(), metadata={"description": text}))
    names = [field.name for field in fields]
    for name in parameter_columns(space).values():
        if names.count(name) > 1:
            raise CaseError(FILE_NAME, "input.id", f'expected an id that does not give the column "{name}" of a sweep.')
    return pa.schema(fields)


def rows_of(
    schema: pa.Schema,
    space: ParameterSpace,
    measures: Mapping[str, Measure],
    tally_names: Sequence[str],
    engine: str,
    candidates: Sequence[int],
    outcomes: Sequence[RunOutcome],
) -> pa.Table:
    """Return the rows of a table for outcomes of runs."""
    columns: dict[str, Sequence[object]] = {
        "candidate": list(candidates),
        "engine": [engine] * len(outcomes),
        "seed": [outcome.request.seed for outcome in outcomes],
        "depart_s": [outcome.request.depart_s for outcome in outcomes],
        "drive": [None if outcome.request.drive == NO_DRIVE else outcome.request.drive for outcome in outcomes],
        "status": [outcome.status.name for outcome in outcomes],
        "num_collisions": [outcome.num_collisions for outcome in outcomes],
        "num_teleports": [outcome.num_teleports for outcome in outcomes],
        "num_arrived": [int(outcome.num_arrived.sum()) for outcome in outcomes],
        "num_inserted": [int(outcome.num_inserted.sum()) for outcome in outcomes],
        "backlog_share": [outcome.backlog_share for outcome in outcomes],
        "num_vehicle_steps": [outcome.num_vehicle_steps for outcome in outcomes],
        "subject_left": [outcome.subject_left for outcome in outcomes],
        "wall_s": [None if np.isnan(outcome.wall_s) else outcome.wall_s for outcome in outcomes],
        "log_tail": [shorten(outcome.log_tail, LONGEST_LOG) or None for outcome in outcomes],
    }
    for place, column in enumerate(parameter_columns(space).values()):
        columns[column] = [float(outcome.request.values[place]) for outcome in outcomes]
    tallies = [
        dict(zip(tally_names, np.asarray(outcome.observed, float).tolist(), strict=True))
        if outcome.status.is_ok
        else None
        for outcome in outcomes
    ]
    for name, measure in measures.items():
        values = [None if tally is None else measure.value(tally) for tally in tallies]
        columns[name] = [one.value if one is not None and one.is_valid else None for one in values]
        columns[OBSERVATIONS + name] = [None if one is None else one.num_observations for one in values]
    return pa.table([pa.array(columns[field.name], field.type) for field in schema], schema=schema)
