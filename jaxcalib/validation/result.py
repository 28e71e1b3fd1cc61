"""What a validation returns, and validation.json."""

from typing import Any

import msgspec

from jaxcalib.calibration.result.result import SimulationHealth
from jaxcalib.validation.criterion import FORMAT, Criterion


class ValidationResult(msgspec.Struct, frozen=True):
    """Result of `jaxcalib.validate`; the same as validation.json, see docs/validate.md.

    Attributes:
        case: name of the case.
        is_valid: whether no criterion that could be answered fails.
        drives: ids of the drives that it was judged by.
        role: their role.
        parameters: values that were validated, by name.
        criteria: each with its standard.
        measures: field and rounds of simulated drives, by measure.
        distributions: distances, by quantity.
        trajectories: errors of single trajectories, by kind.
        travel_times: by drive.
        errors: Eqs. 23-36 with 90 % interval and noise floor.
        equivalence: of each quantity that gives an MoE, whether it is the same within a margin.
        encounters: which of the field's encounters the simulation makes, by kind.
        tails: deceleration that avoids a crash and is needed once in 1000 km, by actor.
        volumes: volumes that the subject vehicle saw, by section, with their GEH.
        counts: counted and simulated volumes, where there are counts.
        health: what went wrong in the runs, counted.
        runs: number of SUMO runs.
        seeds: first and last.
        num_rounds: complete rounds of drives.
        wall_s: times.
        warnings: what a user should know.
        versions: of the program and its libraries.
        commit: of the program.
        step_error: with `--half-step` by how much each of these quantities differs from that with half the step.
        profile: with `--profile` where the time has gone by kind of work; None otherwise.
    """

    case: str
    is_valid: bool
    drives: list[str]
    role: str
    parameters: dict[str, float]
    criteria: list[Criterion]
    measures: dict[str, Any]
    distributions: dict[str, Any]
    trajectories: dict[str, Any]
    travel_times: dict[str, Any]
    errors: dict[str, Any]
    equivalence: dict[str, Any]
    encounters: dict[str, Any]
    tails: dict[str, Any]
    volumes: list[dict[str, Any]]
    counts: list[dict[str, Any]]
    health: SimulationHealth
    runs: int
    seeds: list[int]
    num_rounds: int
    wall_s: dict[str, float]
    warnings: list[str]
    versions: dict[str, str]
    commit: str | None
    step_error: dict[str, Any] | None = None
    profile: dict[str, Any] | None = None
    format: int = FORMAT
