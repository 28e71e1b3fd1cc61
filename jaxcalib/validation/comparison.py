"""Field against rounds of simulated drives: measures, distributions and trajectories."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.result.result import rounded
from jaxcalib.measures.measure import Measure
from jaxcalib.statistics.multiple_tests import holm
from jaxcalib.validation.distributions import BORDERS, distances
from jaxcalib.validation.observer import ObservedDrives
from jaxcalib.validation.prediction import PROBABILITY, Prediction, exceedance, predict, upper_limit
from jaxcalib.validation.trajectories import passing_rmse_s, speed_rmse_mps, travel_times_s

FEWEST_EVENTS = 5.0  # a field that shows fewer says nothing of a measure
SIGNIFICANCE = 0.05
Table = dict[str, dict[str, Any]]
ErrorOf = Callable[[np.ndarray, np.ndarray], float]


def compare_measures(
    measures: Mapping[str, Measure], tally_names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives
) -> Table:
    """Return every measure: the field's value beside what rounds of as many simulated drives show, [round, drive]."""
    real = dict(zip(tally_names, field.tally.sum(axis=0), strict=True))
    simulated = [dict(zip(tally_names, tallies, strict=True)) for tallies in rounds.tally.sum(axis=1)]
    table: Table = {}
    predictions: dict[str, Prediction | None] = {}
    for name, measure in measures.items():
        in_field = measure.value(real)
        values = np.asarray([measure.value(tallies).value for tallies in simulated], float)
        is_enough = in_field.is_valid and in_field.num_observations >= FEWEST_EVENTS
        predictions[name] = predict(values, in_field.value if is_enough else float("nan"))
        few = "" if is_enough else f"fewer than {FEWEST_EVENTS:.0f} observations in the field"
        table[name] = {
            "field": rounded(in_field.value),
            "num_observations": rounded(in_field.num_observations),
            **_prediction_entry(predictions[name]),
            "note": in_field.reason or few,
        }
    p_values = np.asarray([prediction.p_value if prediction else np.nan for prediction in predictions.values()])
    for name, p_value, adjusted in zip(table, p_values, holm(p_values), strict=True):
        table[name] |= {
            "p_value": rounded(float(p_value)),
            "p_adjusted": rounded(float(adjusted)),
            "is_beyond_chance": bool(adjusted < SIGNIFICANCE) if np.isfinite(adjusted) else None,
        }
    return table


def compare_distributions(field: ObservedDrives, rounds: ObservedDrives) -> Table:
    """Return how far each distribution is from the field's, and how far single rounds are from all others."""
    table: Table = {}
    for name in BORDERS:
        per_round = rounds.histograms[name].sum(axis=1)
        total = per_round.sum(axis=0)
        in_field = distances(name, field.histograms[name].sum(axis=0), total)
        by_chance = np.asarray([distances(name, counts, total - counts) for counts in per_round])
        table[name] = {
            kind: _within_chance(in_field[number], by_chance[:, number], most)
            for number, (kind, most) in enumerate((("kolmogorov_smirnov", 1.0), ("wasserstein", np.inf)))
        }
    return table


def compare_trajectories(field: ObservedDrives, rounds: ObservedDrives) -> Table:
    """Return errors of single trajectories: simulated runs against the field's drive, and against one another.

    A simulation that drives as the field does is as far from the field's drive as its own runs are from each other.
    """
    errors: dict[str, ErrorOf] = {
        "speed_rmse_mps": speed_rmse_mps,
        "passing_time_rmse_s": passing_rmse_s,
        "travel_time_error": _travel_time_error,
    }
    table: Table = {}
    for name, error_of in errors.items():
        per_round = _among(rounds.passing_s, error_of)
        against_field = [
            error_of(real, run)
            for real, runs in zip(field.passing_s, rounds.passing_s.swapaxes(0, 1), strict=True)
            for run in runs
        ]
        table[name] = _within_chance(_mean(np.asarray(against_field)), per_round)
    return table


def travel_time_table(names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives) -> Table:
    """Return the travel time of each drive over the stretch that its runs share with it, mean over rounds."""
    table: Table = {}
    for drive, name in enumerate(names):
        pairs = np.asarray([travel_times_s(field.passing_s[drive], run) for run in rounds.passing_s[:, drive]])
        known = np.isfinite(pairs).all(axis=1)
        means = pairs[known].mean(axis=0) if known.any() else np.full(2, np.nan)
        table[name] = {"field_s": rounded(float(means[0])), "simulated_s": rounded(float(means[1]))}
    return table


def _within_chance(value: float, by_chance: Float[np.ndarray, " round"], most: float = np.inf) -> dict[str, Any]:
    return {
        "value": rounded(value),
        "among_simulated": rounded(_mean(by_chance)),
        "limit": rounded(min(upper_limit(by_chance), most)),
        "p_value": rounded(exceedance(by_chance, value)),
    }


def _among(passing_s: Float[np.ndarray, "round drive place"], error_of: ErrorOf) -> Float[np.ndarray, " round"]:
    """Return the mean error of each round against all others, drive by drive."""
    count = len(passing_s)
    pairs = np.full((count, count), np.nan)
    for one in range(count):
        for other in range(one):
            errors = [error_of(a, b) for a, b in zip(passing_s[one], passing_s[other], strict=True)]
            pairs[one, other] = pairs[other, one] = _mean(np.asarray(errors))
    return np.asarray([_mean(row) for row in pairs])


def _travel_time_error(one: np.ndarray, other: np.ndarray) -> float:
    """Return the absolute difference of travel times over their mean, so that it does not matter which is which."""
    times = travel_times_s(one, other)
    return (
        2.0 * abs(times[0] - times[1]) / sum(times) if np.isfinite(times).all() and sum(times) > 0.0 else float("nan")
    )


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _prediction_entry(prediction: Prediction | None) -> dict[str, Any]:
    kind = f"{100 * PROBABILITY:.0f}"
    if prediction is None:
        return {"simulated": None, f"interval_{kind}": None, f"interval_{kind}_of_mean": None}
    return {
        "simulated": rounded(prediction.mean),
        f"interval_{kind}": [rounded(prediction.lower), rounded(prediction.upper)],
        f"interval_{kind}_of_mean": [rounded(prediction.mean_lower), rounded(prediction.mean_upper)],
    }
