"""Whether simulation and field are the same within a margin: shown, refuted, or left open by too few drives.

That a test finds no difference is no evidence that there is none. So the question is turned round: two one-sided tests
ask whether the difference lies above the lower and below the upper end of the margin, and only where both say yes at
5 % is a quantity called equivalent; where the whole interval lies outside, it is different.

Drives and rounds are drawn anew, each for itself, to know the errors of both sides; with few drives the quantiles of
Student's t are the wider ones that these errors need.

Sources: Schuirmann (1987), J. Pharmacokinet. Biopharm. 15, 657-680; the bootstrap's standard error, Efron & Tibshirani
(1993), An Introduction to the Bootstrap, ch. 6; the degrees of freedom, Welch (1947), Biometrika 34, eq. 28.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import stats

from jaxcalib.calibration.result.result import rounded
from jaxcalib.measures.measure import Measure, Moe
from jaxcalib.validation.comparison import FEWEST_EVENTS
from jaxcalib.validation.margins import Margin
from jaxcalib.validation.observer import ObservedDrives

EQUIVALENT, DIFFERENT, OPEN = "equivalent", "different", "not enough drives"
ONE_SIDED = 0.05  # chance of calling equivalent what is as far apart as the margin
NUM_DRAWS = 1000
FEWEST_DRIVES = 3
NOT_KNOWN = (math.nan, math.nan)
MOST_MORE = 999  # drives that are asked for; more is no advice


def compare_within_margins(
    measures: Mapping[str, Measure],
    margins: Mapping[Moe, Margin],
    tally_names: tuple[str, ...],
    field: ObservedDrives,
    rounds: ObservedDrives,
    random: np.random.Generator,
) -> dict[str, dict[str, Any]]:
    """Return for each measure that gives an MoE how far simulation and field are apart, and what that says.

    Args:
        measures: all of them, by name.
        margins: of each MoE.
        tally_names: names of the tallies.
        field: the field's drives, [drive].
        rounds: rounds of as many simulated ones, [round, drive].
        random: of the draws.

    Returns:
        By the measure's name: `field`, `simulated`, `difference` (of the simulated value from the field's, as a share
        of the field's) with `interval_90`, `margin`, `source`, `verdict`, `more_drives` (how many more would tell; null
        where that is not known) and a `note`.
    """
    of_rounds = rounds.tally.sum(axis=1)
    table = {}
    for name, measure in measures.items():
        if measure.moe is None:
            continue

        def value(tallies: np.ndarray, measure: Measure = measure) -> float:
            return measure.value(dict(zip(tally_names, tallies.sum(axis=0), strict=True))).value

        in_field = measure.value(dict(zip(tally_names, field.tally.sum(axis=0), strict=True)))
        margin = margins[measure.moe]
        entry: dict[str, Any] = {"field": rounded(in_field.value), "simulated": rounded(value(of_rounds))}
        entry |= {"margin": margin.share, "source": margin.source}
        fewest = min(FEWEST_EVENTS, len(field.tally))  # what each drive shows once is one for each
        if not in_field.is_valid or in_field.num_observations < fewest or in_field.value == 0.0:
            words = in_field.reason or f"fewer than {fewest:.0f} observations in the field"
            table[name] = entry | _verdict(math.nan, NOT_KNOWN, margin.share, len(field.tally)) | {"note": words}
            continue
        difference = (value(of_rounds) - in_field.value) / in_field.value
        variances, freedom = _errors(value, field.tally, of_rounds, random)
        interval = fieller_interval(
            value(of_rounds), in_field.value, *variances, float(stats.t.ppf(1.0 - ONE_SIDED, freedom))
        )
        table[name] = entry | _verdict(difference, interval, margin.share, len(field.tally)) | {"note": ""}
    return table


def fieller_interval(
    simulated: float, field: float, simulated_variance: float, field_variance: float, quantile: float
) -> tuple[float, float]:
    """Return the interval of simulated / field - 1, which knows that the field's value is no more certain than it is.

    A ratio of 1 + m lies in it exactly if simulated - (1 + m) field, whose variance is that of the simulated value and
    (1 + m)^2 times the field's, is no farther from 0 than chance: so both one-sided tests hold their 5 % at margins of
    any size, which an interval with the field's value as its unit does not.

    Args:
        simulated: mean of the rounds.
        field: value of the field, not 0.
        simulated_variance: of that mean.
        field_variance: of that value.
        quantile: of Student's t.

    Returns:
        The interval; nan where the field's value cannot be told from 0.

    Source: Fieller (1954), J. R. Stat. Soc. B 16, 175-185.
    """
    certain = field**2 - quantile**2 * field_variance
    if not (math.isfinite(certain) and certain > 0.0):
        return math.nan, math.nan
    under = field**2 * simulated_variance + simulated**2 * field_variance
    reach = quantile * math.sqrt(max(under - quantile**2 * simulated_variance * field_variance, 0.0))
    centre = simulated * field
    return (centre - reach) / certain - 1.0, (centre + reach) / certain - 1.0


def _errors(
    value: Callable[[np.ndarray], float],
    drives: Float[np.ndarray, "drive tally"],
    rounds: Float[np.ndarray, "round tally"],
    random: np.random.Generator,
) -> tuple[tuple[float, float], float]:
    """Return the variances of the values of rounds and of drives, and the degrees of freedom of their difference."""
    variances, freedoms = [], []
    for several in (rounds, drives):
        count = len(several)
        num_seen = sum(math.isfinite(value(one[None])) for one in several)
        if num_seen < FEWEST_DRIVES:  # what one of them alone shows has no scatter, however often that one is drawn
            return NOT_KNOWN, math.nan
        drawn = random.integers(count, size=(NUM_DRAWS, count))
        values = np.asarray([value(several[numbers]) for numbers in drawn])
        # draws of n items scatter by (n - 1) / n less than such items do
        variances.append(float(np.nanvar(values)) * count / (count - 1))
        freedoms.append(count - 1)
    total = sum(variances)
    both = (variances[0], variances[1])
    if not total > 0.0:
        return both, float(min(freedoms))
    return both, total**2 / sum(variance**2 / freedom for variance, freedom in zip(variances, freedoms, strict=True))


def _verdict(difference: float, interval: tuple[float, float], margin: float, num_drives: int) -> dict[str, Any]:
    """Return the verdict on a difference with its 90 % interval."""
    low, high = interval
    is_known = math.isfinite(difference) and math.isfinite(low) and math.isfinite(high)
    entry: dict[str, Any] = {
        "difference": rounded(difference),
        "interval_90": [rounded(low), rounded(high)] if is_known else None,
        "verdict": OPEN,
        "more_drives": None,
    }
    if not is_known:
        return entry
    if low >= -margin and high <= margin:
        return entry | {"verdict": EQUIVALENT, "more_drives": 0}
    if low > margin or high < -margin:
        return entry | {"verdict": DIFFERENT, "more_drives": 0}
    to_go = abs(margin - abs(difference))
    needed = math.inf if to_go == 0.0 else num_drives * (0.5 * (high - low) / to_go) ** 2
    return entry | {
        "more_drives": max(1, min(math.ceil(needed - num_drives), MOST_MORE)) if needed < 1e9 else MOST_MORE
    }
