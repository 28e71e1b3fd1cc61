"""All criteria of a validation."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxcalib.calibration.accuracy import VEHICLE_LEVEL_SUM
from jaxcalib.calibration.evaluator import MOST_FAILED_SHARE
from jaxcalib.calibration.final_errors import FinalErrors
from jaxcalib.validation.comparison import SIGNIFICANCE, Table
from jaxcalib.validation.criterion import FHWA_2004, FHWA_2019, OWN, Criterion, at_least, at_most, not_testable
from jaxcalib.validation.volumes import GEH_STANDARD
from sim_adapters.interface import RunOutcome

LARGE_BACKLOG = 0.01
NO_COUNTS = "the case has no counts; give them with --counts (docs/validation.md)"


def health_criteria(outcomes: Sequence[RunOutcome]) -> list[Criterion]:
    """Return whether SUMO could run what the parameters ask for."""
    ran = [one for one in outcomes if one.status.is_ok]
    failed = 1.0 - len(ran) / len(outcomes)
    backlog = float(np.mean([one.backlog_share for one in ran])) if ran else float("nan")
    return [
        at_most("share of runs that failed", OWN, failed, MOST_FAILED_SHARE),
        at_most("teleports", OWN, sum(one.num_teleports for one in ran), 0.0, "vehicles that SUMO removed"),
        at_most("collisions", OWN, sum(one.num_collisions for one in ran), 0.0, "vehicle steps in a collision"),
        at_most("share of the demand not inserted", OWN, backlog, LARGE_BACKLOG, "mean over runs"),
    ]


def error_criteria(errors: FinalErrors | None) -> list[Criterion]:
    """Return whether each error of the paper lies within what chance leaves."""
    if errors is None:
        return []
    criteria = []
    for name in [*errors.pooled.errors, VEHICLE_LEVEL_SUM]:
        value, limit = errors.error(name), errors.floor_high.get(name)
        title = f"error of {name.replace('_', ' ')} within the noise floor (95 %)"
        if value is None or limit is None:
            criteria.append(not_testable(title, OWN, errors.pooled.notes.get(name, "no noise floor")))
        else:
            criteria.append(at_most(title, OWN, value, limit, "Eqs. 23-36, all runs pooled"))
    return criteria


def comparison_criteria(measures: Table, distributions: Table, trajectories: Table) -> list[Criterion]:
    """Return whether measures, distributions and trajectories differ by no more than chance."""
    tested = [name for name, one in measures.items() if one["is_beyond_chance"] is not None]
    beyond = [name for name in tested if measures[name]["is_beyond_chance"]]
    note = f"{len(tested)} measures tested" + (f"; beyond: {', '.join(beyond[:6])}" if beyond else "")
    criteria = [
        at_most(f"measures beyond chance (Holm, {SIGNIFICANCE:.0%})", OWN, len(beyond), 0.0, note)
        if tested
        else not_testable("measures beyond chance", OWN, "no measure has a prediction; more seeds?")
    ]
    for name, one in distributions.items():
        title = f"distribution of {name}: Wasserstein distance within chance (95 %)"
        criteria.append(_within(title, one["wasserstein"]["value"], one["wasserstein"]["limit"]))
    for name, one in trajectories.items():
        criteria.append(_within(f"trajectories: {name} within chance (95 %)", one["value"], one["limit"]))
    return criteria


def travel_time_criterion(table: Table) -> Criterion:
    """Return the criterion of 2004 for travel times: within 15 %, or a minute if that is more, in 85 % of the cases."""
    title = "share of drives with a travel time within 15 % or 1 min"
    known = [one for one in table.values() if one["field_s"] and one["simulated_s"]]
    if not known:
        return not_testable(title, FHWA_2004, "no drive shares a stretch with its runs")
    share = np.mean([abs(one["simulated_s"] - one["field_s"]) <= max(0.15 * one["field_s"], 60.0) for one in known])
    return at_least(title, FHWA_2004, float(share), 0.85, f"{len(known)} drives, mean over seeds")


def criteria_without_counts() -> list[Criterion]:
    """Return the criteria that need counts, unanswered."""
    return [
        not_testable("share of volumes with GEH below 5", GEH_STANDARD, NO_COUNTS),
        not_testable("criteria I-IV of bounded dynamic error", FHWA_2019, NO_COUNTS),
    ]


def _within(title: str, value: Any, limit: Any) -> Criterion:
    if value is None or limit is None:
        return not_testable(title, OWN, "too few observations in field or simulation")
    return at_most(title, OWN, float(value), float(limit), "limit: what one round of simulated drives shows by chance")
