"""All criteria of a validation."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.calibration.stages.evaluator import MOST_FAILED_SHARE
from jaxcalib.validation.comparison import SIGNIFICANCE, Table
from jaxcalib.validation.criterion import FHWA_2004, FHWA_2019, OWN, Criterion, at_least, at_most, not_testable
from jaxcalib.validation.volumes import GEH_STANDARD
from sim_adapters.interface import RunOutcome

LARGE_BACKLOG = 0.01
MOST_CUT_SHORT = 0.1
NO_COUNTS = "the case has no counts; give them with --counts (docs/validate.md)"


def health_criteria(outcomes: Sequence[RunOutcome]) -> list[Criterion]:
    """Return whether SUMO could run what the parameters ask for."""
    ran = [outcome for outcome in outcomes if outcome.status.is_ok]
    failed = 1.0 - len(ran) / len(outcomes)
    backlog = float(np.mean([outcome.backlog_share for outcome in ran])) if ran else float("nan")
    return [
        at_most("share of runs that failed", OWN, failed, MOST_FAILED_SHARE),
        at_most("teleports", OWN, sum(outcome.num_teleports for outcome in ran), 0.0, "vehicles that SUMO removed"),
        at_most("collisions", OWN, sum(outcome.num_collisions for outcome in ran), 0.0, "vehicle steps in a collision"),
        at_most("share of the demand not inserted", OWN, backlog, LARGE_BACKLOG, "mean over runs"),
    ]


def arrival_criterion(is_cut_short: np.ndarray) -> Criterion:
    """Return whether simulated drives come as far as the field's, [round, drive]."""
    note = "simulated drives that were a minute or more behind the field's when their run ended"
    return at_most("share of drives that did not come as far", OWN, float(is_cut_short.mean()), MOST_CUT_SHORT, note)


def chance_criteria(measures: Table, distributions: Table, trajectories: Table) -> list[Criterion]:
    """Return whether field and simulation differ by no more than chance; probabilities have been corrected together."""
    tested = [name for name, entry in measures.items() if entry["is_beyond_chance"] is not None]
    beyond = [name for name in tested if measures[name]["is_beyond_chance"]]
    note = f"{len(tested)} measures tested" + (f"; beyond: {', '.join(beyond[:6])}" if beyond else "")
    criteria = [
        at_most("measures beyond chance", OWN, len(beyond), 0.0, note)
        if tested
        else not_testable("measures beyond chance", OWN, "no measure has a prediction; more seeds?")
    ]
    entries = {f"distribution of {_words(name)}": entry for name, entry in distributions.items()}
    entries |= {f"trajectories, {_words(name)}": entry for name, entry in trajectories.items()}
    for name, entry in entries.items():
        title = f"{name}: probability of as much by chance"
        if entry["p_adjusted"] is None:
            criteria.append(not_testable(title, OWN, "too few observations in field or simulation"))
            continue
        note = f"{entry['value']:.3g} found, {entry['limit']:.3g} is exceeded by chance in 5 %"
        criteria.append(at_least(title, OWN, entry["p_adjusted"], SIGNIFICANCE, note))
    return criteria


def travel_time_criterion(table: Table) -> Criterion:
    """Return the criterion of 2004 for travel times: within 15 %, or a minute if that is more, in 85 % of the cases."""
    title = "share of drives with a travel time within 15 % or 1 min"
    known = [entry for entry in table.values() if entry["field_s"] and entry["simulated_s"]]
    if not known:
        return not_testable(title, FHWA_2004, "no drive shares a stretch with its runs")
    field_s, simulated_s = (np.asarray([entry[name] for entry in known]) for name in ("field_s", "simulated_s"))
    is_near = np.abs(simulated_s - field_s) <= np.maximum(0.15 * field_s, 60.0)
    # of a drive that mostly does not arrive the time is longer than anybody has seen
    share = np.mean(is_near & np.asarray([entry["cut_short"] <= 0.5 for entry in known]))
    return at_least(title, FHWA_2004, float(share), 0.85, f"{len(known)} drives, mean over seeds")


def criteria_without_counts() -> list[Criterion]:
    """Return the criteria that need counts, unanswered."""
    return [
        not_testable("share of volumes with GEH below 5", GEH_STANDARD, NO_COUNTS),
        not_testable("criteria I-IV of bounded dynamic error", FHWA_2019, NO_COUNTS),
    ]


def _words(name: str) -> str:
    return name.replace("_", " ")
