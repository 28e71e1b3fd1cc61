"""What a calibration returns, and result.json."""

import math
from typing import Any

import msgspec

FORMAT = 1
DIGITS = 6


class Interval(msgspec.Struct, frozen=True):
    """An estimate with its bounds."""

    value: float
    lower: float | None  # lower bound of the 90 % interval; None where the data say nothing
    upper: float | None  # upper bound
    at_bound: bool  # whether the value lies on a bound of its range
    # whether logs and measures tell it: not at a bound, and an interval narrower than half of its range
    is_identified: bool
    scenario: float  # what the scenario says
    initial: float  # what the logs said before the search
    source: str  # where the initial value comes from
    unit: str  # SI unit; veh/h for inputs


class SimulationHealth(msgspec.Struct, frozen=True):
    """What went wrong in runs, counted."""

    runs: int
    failed: int  # runs that failed
    unfinished: int  # drives of other runs that did not reach their destination before the end
    collisions: int  # vehicle steps in a collision
    teleports: int  # vehicles that SUMO removed
    subject_overlaps: int  # steps in which a replayed subject vehicle overlaps another vehicle
    backlog_share: float  # share of the demand that had not entered by the end


class CalibrationResult(msgspec.Struct, frozen=True):
    """Result of `jaxcalib.calibrate`; the same as result.json, see docs/result.md.

    Attributes:
        parameters: "demand" by input in veh/h, "behaviour" by vType and attribute.
        critical_parameters: driver parameters that range analysis found critical, the most critical first.
        mops: measures of performance: field, surrogate and SUMO, by role.
        moes: errors of Eqs. 24-36 in SUMO: no_calibration, calibrated, noise_floor, by role.
        runs: numbers of runs.
        wall_s: times.
        notes: why a value is null.
        parameter_table: each parameter with its interval.
        vehicle_level_error: Eq. 23 with its 90 % interval, by calibration and role.
        intervals: 90 % intervals of the errors, by calibration and role.
        change: errors calibrated less those uncalibrated, with 90 % intervals, by role; above 0 is worse.
        per_seed: mean over seeds of the errors of single rounds of drives.
        noise_floor_high: 95 % quantile of the noise floor.
        transfer: surrogate against SUMO, per measure.
        confirmation: finalists with their accuracy in both simulators.
        screening: what was screened and why.
        health: failures, unfinished drives, collisions, teleports, backlog of SUMO's runs, and of the surrogate's with
            the result on held-out drives.
        seeds: first seeds of each kind of run.
        timing: measured times and the ratio of speeds; not reproducible.
        scenario: how well the surrogate can follow each part of the scenario: `level`, `file`, `element`, `words`,
            `count`, as `jaxcalib check` says.
        warnings: what a user should know.
        versions: of the program and its libraries.
        commit: of the program.
        profile: with `--profile` where the time has gone by kind of work, and how much of the cores' was used.
    """

    parameters: dict[str, Any]
    critical_parameters: list[str]
    mops: dict[str, dict[str, dict[str, float | None]]]
    moes: dict[str, dict[str, dict[str, float | None]]]
    runs: dict[str, int]
    wall_s: dict[str, float]
    notes: dict[str, str]
    parameter_table: dict[str, Interval]
    vehicle_level_error: dict[str, dict[str, Any]]
    intervals: dict[str, Any]
    change: dict[str, Any]
    per_seed: dict[str, Any]
    noise_floor_high: dict[str, Any]
    transfer: list[dict[str, Any]]
    confirmation: dict[str, Any]
    screening: dict[str, Any]
    health: dict[str, SimulationHealth]
    seeds: dict[str, int]
    timing: dict[str, float]
    scenario: list[dict[str, Any]]
    warnings: list[str]
    versions: dict[str, str]
    commit: str | None = None
    profile: dict[str, Any] | None = None
    format: int = FORMAT


def to_json(result: msgspec.Struct) -> str:
    """Return a result with a format as JSON: sorted as declared, numbers that are not finite as null."""
    plain = msgspec.to_builtins(result)
    ordered = {"format": plain.pop("format"), **plain}
    return msgspec.json.format(msgspec.json.encode(_finite(ordered)), indent=1).decode() + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def rounded(value: float | None) -> float | None:
    """Return a value with as many digits as mean anything; what is not finite becomes None."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS}g}")
