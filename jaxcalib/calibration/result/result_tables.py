"""Turns what a calibration found into its result."""

from dataclasses import asdict
from typing import Any

import numpy as np

from jaxcalib.calibration.confirmation.final_errors import (
    FinalRuns,
    all_runs_of_role,
    final_errors,
    runs_of_role,
)
from jaxcalib.calibration.confirmation.transfer import transfer_of
from jaxcalib.calibration.first_look import AGREEMENT
from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.result.error_tables import (
    change_table,
    effectiveness_table,
    held_out_warnings,
    part_by_role,
    vehicle_level_table,
)
from jaxcalib.calibration.result.result import CalibrationResult, Interval, SimulationHealth, rounded
from jaxcalib.calibration.result.simulation_health import health_of, missing_warnings, unfinished_warnings
from jaxcalib.calibration.result.uncertainty import parameter_errors
from jaxcalib.calibration.stages.evaluator import Evaluations
from jaxcalib.calibration.stages.screening import Screening
from jaxcalib.case.case import ROLES, Role
from jaxcalib.measures.measure import MeasureValue
from jaxcalib.runs.profile import profile
from jaxcalib.runs.provenance import commit, versions
from jaxcalib.statistics.normal import HALF_WIDTH_90
from sim_adapters.activity import Activity, doing
from sim_adapters.interface import RunOutcome
from sim_adapters.scenario.finding import sorted_findings

NEAR_BOUND = 0.005  # of the unit range
WIDE = 0.5  # of the unit range: an interval as wide says that nothing tells the parameter
SEARCH_PARTS = (AGREEMENT, "stage1", "stage2_exploration", "stage2_optimisation", "corrected_search")


@doing(Activity.REPORT)
def build_result(record: CalibrationRecord) -> CalibrationResult:
    """Return the result of a calibration."""
    problem, space, layout = record.problem, record.initial.space, record.problem.layout
    best = record.confirmation.best
    values = space.values_of(best[None])[0]
    demand = dict(zip(layout.input_ids, map(float, values), strict=False))
    behaviour = [float(value) for value in values[layout.num_inputs :]]
    calibrated: dict[Role, FinalRuns] = {role: runs_of_role(problem, record.calibrated, role) for role in ROLES}
    uncalibrated = {role: runs_of_role(problem, record.uncalibrated, role) for role in ROLES}
    errors = {
        "no_calibration": {role: final_errors(problem, role, uncalibrated[role], None) for role in ROLES},
        "calibrated": {
            role: final_errors(problem, role, calibrated[role], _floor_runs(record, role)) for role in ROLES
        },
    }
    notes: dict[str, str] = {}
    mops = _mops(record, calibrated, notes)
    return CalibrationResult(
        parameters={"demand": demand, "behaviour": {name: layout.values_of(name, behaviour) for name in layout.vtypes}},
        critical_parameters=[space.names[place] for place in record.found.critical],
        mops=mops,
        moes=effectiveness_table(errors, notes),
        runs={
            "surrogate": record.num_surrogate_runs,
            "sumo": record.num_sumo_search_runs + sum(_health(record)[name].runs for name in _sumo_outcomes(record)),
        },
        wall_s=record.wall_s,
        profile=profile(),
        notes=notes,
        parameter_table=_parameter_table(record),
        vehicle_level_error=vehicle_level_table(errors),
        intervals=part_by_role(errors, lambda one: one.interval),
        change=change_table(errors),
        per_seed=part_by_role(errors, lambda one: one.per_seed),
        noise_floor_high={role: one.floor_high if one else {} for role, one in errors["calibrated"].items()},
        transfer=[
            {"measure": one.measure, "bias": one.bias, "bias_in_noise": one.bias_in_noise,
             "rank_correlation": one.rank_correlation}
            for one in transfer_of(
                record.found.objective.moments, record.found.objective.covariance, record.found.objective.num_drives,
                record.confirmation.confirmed,
            )
        ],
        confirmation={
            "finalists": [
                {"origin": one.origin, "accuracy_sumo": one.accuracy, "accuracy_surrogate": one.surrogate_accuracy}
                for one in record.confirmation.finalists
            ],
            "winner": record.confirmation.winner,
            "surrogate_agrees": bool(record.agreements) and all(one.holds for one in record.agreements),
            "surrogate_ranks_alike": record.confirmation.agrees,
            "agreement": [one.as_table() for one in record.agreements],
            "searched_in_sumo": record.is_in_sumo,
            "went_on_by": record.confirmation.went_on_by,
            "discrepancy_in_noise": record.confirmation.discrepancy.amplitude,
            "noise_floor_accuracy": record.found.objective.noise_floor_accuracy,
            "flow_accuracy_stage1_stage2_polish": list(record.found.stage_1_accuracy),
            "stage2_undid_stage1": record.found.has_drifted,
            "gradient": _gradient(record),
        },
        screening={
            "stage1": _screening(record, record.found.stage_1),
            "stage2": _screening(record, record.found.exploration),
        },
        health=_health(record),
        seeds=record.search_seeds,
        timing=_timing(record),
        scenario=[asdict(one) | {"level": one.level.value} for one in sorted_findings(problem.scenario.findings)],
        warnings=[
            *problem.warnings(),
            *record.notes,
            *(str(one) for one in record.agreements if not one.holds),
            *_bound_warnings(record),
            *unfinished_warnings(_health(record)),
            *missing_warnings(
                {
                    "calibrated": record.calibrated["held_out"].outcomes,
                    "the scenario's": record.uncalibrated["held_out"].outcomes,
                }
            ),
            *held_out_warnings(errors),
        ],
        versions=versions(),
        commit=commit(),
    )  # fmt: skip


def _gradient(record: CalibrationRecord) -> dict[str, Any] | None:
    refined = record.found.refinement
    if refined is None:
        return None
    return {
        "parameters": [
            {"name": name, "is_usable": usable, "disagreement": rounded(disagreement)}
            for name, usable, disagreement in zip(refined.names, refined.is_usable, refined.disagreement, strict=True)
        ],
        "misfit_before": rounded(refined.before),
        "misfit_after": rounded(refined.after),
    }


def _floor_runs(record: CalibrationRecord, role: Role) -> FinalRuns:
    """Return all SUMO runs of the result that could be drives of a role: those for the other role, too."""
    values = record.initial.space.values_of(record.confirmation.best[None])[0]
    confirming = [one for one in record.confirmation.outcomes if np.array_equal(one.request.values, values)]
    return all_runs_of_role(record.problem, record.calibrated, role, confirming)


def _mops(
    record: CalibrationRecord, calibrated: dict[Role, FinalRuns], notes: dict[str, str]
) -> dict[str, dict[str, dict[str, float | None]]]:
    problem = record.problem
    winner = record.confirmation.confirmed[record.confirmation.winner]
    sources: dict[str, dict[str, np.ndarray | None]] = {
        "field": {role: problem.field_of(role).sum(axis=0) for role in ROLES},
        "surrogate": {
            "fit": None if record.is_in_sumo else winner.surrogate_runs * winner.surrogate,
            "held_out": _summed(record.surrogate_on_held_out),
        },
        "sumo": {role: calibrated[role].tally.sum(axis=0) for role in ROLES},
    }
    if sources["surrogate"]["held_out"] is None:
        notes["mops.surrogate.held_out"] = "no held-out drive, or the surrogate failed on them"
    if record.is_in_sumo:
        notes["mops.surrogate.fit"] = "SUMO made the search's runs; see warnings for what the surrogate cannot follow"
    return {
        source: {
            role: {} if tally is None else _measured(record, f"mops.{source}.{role}", tally, notes)
            for role, tally in by_role.items()
        }
        for source, by_role in sources.items()
    }


def _summed(evaluations: Evaluations | None) -> np.ndarray | None:
    """Return the tally of one candidate, summed over runs; None where there is none or it failed."""
    if evaluations is None or not evaluations.is_ok[0]:
        return None
    return evaluations.tally.shape[1] * evaluations.pooled[0]


def _measured(
    record: CalibrationRecord, place: str, tally: np.ndarray, notes: dict[str, str]
) -> dict[str, float | None]:
    by_name = dict(zip(record.problem.tally_names, tally.tolist(), strict=True))
    values: dict[str, MeasureValue] = {
        name: measure.value(by_name) for name, measure in record.problem.measures.items()
    }
    notes |= {f"{place}.{name}": value.reason for name, value in values.items() if not value.is_valid}
    return {name: rounded(value.value) if value.is_valid else None for name, value in values.items()}


def _parameter_table(record: CalibrationRecord) -> dict[str, Interval]:
    space, best = record.initial.space, record.confirmation.best
    error = parameter_errors(record)
    low = space.values_of((best - HALF_WIDTH_90 * error)[None])[0]
    high = space.values_of((best + HALF_WIDTH_90 * error)[None])[0]
    values = space.values_of(best[None])[0]
    table = {}
    for place, name in enumerate(space.names):
        is_known = np.isfinite(error[place])
        table[name] = Interval(
            value=float(values[place]),
            lower=float(low[place]) if is_known else None,
            upper=float(high[place]) if is_known else None,
            at_bound=_is_at_bound(record, place),
            is_identified=bool(is_known and 2.0 * HALF_WIDTH_90 * error[place] < WIDE)
            and not _is_at_bound(record, place),
            scenario=float(record.initial.scenario_values[place]),
            initial=float(record.initial.values[place]),
            source=record.initial.source[place],
            unit=space.ranges[place].unit,
        )
    return table


def _is_at_bound(record: CalibrationRecord, place: int) -> bool:
    return bool(min(record.confirmation.best[place], 1.0 - record.confirmation.best[place]) < NEAR_BOUND)


def _bound_warnings(record: CalibrationRecord) -> list[str]:
    space = record.initial.space
    may_be_extreme = ("lcCooperative", "lcCooperativeSpeed", "lcKeepRight")  # 0 and 1 are ordinary values of these
    natural = {name for attribute in may_be_extreme for name in space.layout.names_of(attribute)}
    return [
        f"{name} lies at a bound of its range ({space.ranges[place].lower:g} to {space.ranges[place].upper:g} "
        f"{space.ranges[place].unit}); widen the bounds or doubt the model."
        for place, name in enumerate(space.names)
        if _is_at_bound(record, place) and name not in natural
    ]


def _screening(record: CalibrationRecord, screening: Screening) -> dict[str, Any]:
    names = [record.initial.space.names[place] for place in screening.box.chosen]
    ranges, noise = screening.ranges, screening.ranges.noise
    return {
        "array": screening.array.name,
        "cases_failed": int((~screening.cases.is_ok).sum()),
        "noise_source": noise.source if noise else None,
        "parameters": [
            {
                "name": names[place],
                "range": rounded(float(ranges.accuracy_range[place])),
                "range_of_noise": rounded(float(noise.null_range_quantile[place])) if noise else None,
                "p_value": rounded(float(noise.p_value[place])) if noise else None,
                "stands_out": bool(noise is not None and not noise.is_indistinguishable[place]),
                "level_means": [rounded(float(mean)) for mean in ranges.level_mean_accuracy[place]],
                "levels": [
                    float(value)
                    for value in record.initial.space.values_of(
                        screening.box.unit_of(
                            np.linspace(0.0, 1.0, screening.array.num_levels)[:, None] * np.ones((1, len(names)))
                        )
                    )[:, screening.box.chosen[place]]
                ],
                "aliased_with": [f"{names[i]} x {names[j]}" for i, j in ranges.aliases[place]],
            }
            for place in ranges.ranking
        ],
    }


def _health(record: CalibrationRecord) -> dict[str, SimulationHealth]:
    groups = _sumo_outcomes(record)
    if record.surrogate_on_held_out is not None:
        groups["surrogate"] = list(record.surrogate_on_held_out.outcomes[0])
    return {name: health_of(group) for name, group in groups.items()}


def _sumo_outcomes(record: CalibrationRecord) -> dict[str, list[RunOutcome]]:
    """Return SUMO's runs by what they were for."""
    groups: dict[str, list[FinalRuns]] = {
        "calibrated": list(record.calibrated.values()),
        "uncalibrated": list(record.uncalibrated.values()),
    }
    outcomes = {name: [outcome for runs in group for outcome in runs.outcomes] for name, group in groups.items()}
    outcomes["confirmation"] = list(record.confirmation.outcomes)
    return {name: group for name, group in outcomes.items() if group}


def _timing(record: CalibrationRecord) -> dict[str, float]:
    # of the runs with one subject vehicle, as the search's are
    final = [outcome for runs in record.calibrated.values() for outcome in runs.outcomes]
    runs = [outcome.wall_s for outcome in final if outcome.status.is_ok]
    sumo_run_s = float(np.mean(runs)) if runs else float("nan")
    search_s = sum(record.wall_s.get(part, 0.0) for part in SEARCH_PARTS)
    num_runs = 0 if record.is_in_sumo else record.num_surrogate_runs  # there is no surrogate's search to compare
    return {
        "search_s": search_s,
        "sumo_run_s": sumo_run_s,
        "sumo_processes": float(record.num_sumo_processes),
        "search_in_sumo_s": num_runs * sumo_run_s / record.num_sumo_processes,
        "speed_ratio": num_runs * sumo_run_s / record.num_sumo_processes / max(search_s, 1e-9),
    }
