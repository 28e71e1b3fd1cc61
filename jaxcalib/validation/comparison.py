"""Field against rounds of simulated drives: measures, distributions and trajectories."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from jaxcalib.calibration.result.result import rounded
from jaxcalib.measures.measure import Measure
from jaxcalib.statistics.multiple_tests import holm
from jaxcalib.validation.distributions import BORDERS, distances
from jaxcalib.validation.observer import ObservedDrives
from jaxcalib.validation.prediction import PROBABILITY, Prediction, exceedance, predict, upper_limit
from jaxcalib.validation.trajectories import passing_rmse_s, speed_rmse_mps, travel_times_s

FEWEST_EVENTS = 5.0  # observations that a value must rest on to say something
FAR_BEHIND_S = 60.0  # as the criterion of 2004 allows travel times to differ by
FEWEST_SHOWING = 0.5  # of the rounds, for the others to be believed
SIGNIFICANCE = 0.05
Table = dict[str, dict[str, Any]]
ErrorOf = Callable[[np.ndarray, np.ndarray], float]


def compare_measures(
    measures: Mapping[str, Measure], tally_names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives
) -> Table:
    """Return every measure: the field's value beside what rounds of as many simulated drives show, [round, drive].

    A probability stands where the measure is tested (`Measure.is_tested`), field and most rounds show it, and they rest
    on enough observations in the mean: chosen by the field's number alone, a test would be of a field that is unlike
    rounds. Where the field alone has enough of it, what is tested is whether as many drives show it at all.
    """
    real, *simulated = (
        dict(zip(tally_names, tallies, strict=True)) for tallies in (field.tally.sum(axis=0), *rounds.tally.sum(axis=1))
    )
    table: Table = {}
    for name, measure in measures.items():
        in_field = measure.value(real)
        values = np.asarray([measure.value(tallies).value for tallies in simulated], float)
        prediction = predict(values, in_field.value)
        telling, *of_rounds = (float(measure.num_telling(tallies)) for tallies in (real, *simulated))
        is_seen = bool(np.isfinite(values).mean() > FEWEST_SHOWING)
        is_enough = float(np.mean([telling, *of_rounds])) >= FEWEST_EVENTS
        is_tested = measure.is_tested and in_field.is_valid and is_seen and is_enough
        p_value = prediction.p_value if prediction and is_tested else None
        few = "" if is_enough else f"rests on fewer than {FEWEST_EVENTS:.0f} observations in the mean"
        lacking = "" if is_seen else "most rounds do not show it"
        if measure.is_tested and telling >= FEWEST_EVENTS > float(np.mean(of_rounds)):
            shows = [_shows(measure, tally_names, drives) for drives in (field.tally, rounds.tally)]
            p_value = _chance_of_showing(*shows)
            few, lacking = "", f"shown by {_share(shows[0])} drives of the field, {_share(shows[1])} simulated"
        table[name] = {
            "field": rounded(in_field.value),
            "num_observations": rounded(in_field.num_observations),
            **_prediction_entry(prediction),
            "note": in_field.reason or lacking or few,
            "p_value": rounded(p_value),
        }
    return table


def _shows(measure: Measure, tally_names: tuple[str, ...], tally: np.ndarray) -> np.ndarray:
    """Return which drives show a measure; drives are independent whatever comes in bursts within them."""
    rows = tally.reshape(-1, tally.shape[-1])
    return np.asarray([measure.num_telling(dict(zip(tally_names, row, strict=True))) > 0.0 for row in rows])


def _chance_of_showing(field: np.ndarray, rounds: np.ndarray) -> float:
    """Return how often as many of the field's drives would show a measure if all drives were alike, in both tails.

    Source: Fisher's exact test, its one tail doubled.
    """
    among, showing = len(field) + len(rounds), int(field.sum() + rounds.sum())
    return float(min(1.0, 2.0 * stats.hypergeom.sf(int(field.sum()) - 1, among, showing, len(field))))


def _share(shows: np.ndarray) -> str:
    return f"{int(shows.sum())} of {shows.size}"


def correct_together(*tables: Table) -> None:
    """Write into all entries with a `p_value` what it is among all of them, and whether that is beyond chance.

    A simulation that is right fails one test in twenty: probabilities are corrected for the number of all tests.
    """
    entries = [entry for table in tables for entry in table.values()]
    p_values = np.asarray([entry["p_value"] for entry in entries], float)  # None becomes nan
    for entry, adjusted in zip(entries, holm(p_values), strict=True):
        is_known = bool(np.isfinite(adjusted))
        entry["p_adjusted"] = rounded(float(adjusted)) if is_known else None
        entry["is_beyond_chance"] = bool(adjusted < SIGNIFICANCE) if is_known else None


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


def cut_short(field: ObservedDrives, rounds: ObservedDrives, has_left: np.ndarray, end_s: float) -> np.ndarray:
    """Return which simulated drives stood far behind the field's when their run ended, [round, drive].

    A drive that the end finds on its way is far behind where the field's passed its next place a minute ago or more.

    Args:
        field: the field's drives.
        rounds: simulated ones.
        has_left: whether the subject vehicle left the road before the run's end, [round, drive].
        end_s: when runs end.
    """
    places = np.arange(field.passing_s.shape[-1])
    last = np.max(np.where(np.isfinite(rounds.passing_s), places, -1), axis=-1)
    is_ahead = np.isfinite(field.passing_s) & (places > last[..., None])
    passed_next_s = np.min(np.where(is_ahead, field.passing_s, np.inf), axis=-1)
    return ~has_left & (end_s - passed_next_s > FAR_BEHIND_S)


def travel_time_table(
    names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives, is_cut_short: np.ndarray
) -> Table:
    """Return the travel time of each drive over the stretch that its runs share with it, mean over rounds.

    How long those stand that the run's end cuts short (`cut_short`) is not known; their share stands beside it.
    """
    table: Table = {}
    for drive, name in enumerate(names):
        pairs = np.asarray([travel_times_s(field.passing_s[drive], run) for run in rounds.passing_s[:, drive]])
        known = np.isfinite(pairs).all(axis=1)
        means = pairs[known].mean(axis=0) if known.any() else np.full(2, np.nan)
        table[name] = {
            "field_s": rounded(float(means[0])),
            "simulated_s": rounded(float(means[1])),
            "cut_short": rounded(float(is_cut_short[:, drive].mean())),
        }
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
