"""Whether simulation and field are the same within a margin: shown, refuted, or left open by too few drives.

That a test finds no difference is no evidence that there is none. So the question is turned round: two one-sided tests
ask whether the difference lies above the lower and below the upper end of the margin, and only where both say yes at
5 % is a quantity called equivalent; where the whole interval lies outside, it is different.

Drives and rounds are drawn anew to know the errors of both sides; a drive is drawn on both sides at once, since it is
the same hour of the same road: that hours differ makes no difference uncertain. With few drives the quantiles of
Student's t are the wider ones that these errors need.

Sources: Schuirmann (1987), J. Pharmacokinet. Biopharm. 15, 657-680; the bootstrap's standard error, Efron & Tibshirani
(1993), An Introduction to the Bootstrap, ch. 6; the degrees of freedom, Welch (1947), Biometrika 34, eq. 28.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
    *,
    shares_drives: bool = True,
) -> dict[str, dict[str, Any]]:
    """Return for each measure that gives an MoE how far simulation and field are apart, and what that says.

    Args:
        measures: all of them, by name.
        margins: of each MoE.
        tally_names: names of the tallies.
        field: the field's drives, [drive].
        rounds: rounds of as many simulated ones, [round, drive].
        random: of the draws.
        shares_drives: whether the field's drives are those of a round, in the same order.

    Returns:
        By the measure's name: `field`, `simulated`, `difference` (of the simulated value from the field's, as a share
        of the field's) with `interval_90`, `margin`, `source`, `verdict`, `more_drives` (how many more would tell; null
        where that is not known) and a `note`.
    """
    number = {name: index for index, name in enumerate(tally_names)}
    table = {}
    for name, measure in measures.items():
        if measure.moe is None:
            continue

        needed = measure.tallies()
        columns = [number[tally] for tally in needed]
        drives, runs = field.tally[:, columns], rounds.tally[:, :, columns]

        def value(tallies: np.ndarray, measure: Measure = measure, names: tuple[str, ...] = needed) -> float:
            return measure.value(dict(zip(names, tallies, strict=True))).value

        in_field = measure.value(dict(zip(needed, drives.sum(axis=0), strict=True)))
        simulated = value(runs.sum(axis=(0, 1)))
        margin = margins[measure.moe]
        entry: dict[str, Any] = {"field": rounded(in_field.value), "simulated": rounded(simulated)}
        entry |= {"margin": margin.share, "source": margin.source}
        is_enough = measure.is_per_drive or in_field.num_observations >= FEWEST_EVENTS  # drives are drawn anew below
        if not in_field.is_valid or not is_enough or in_field.value == 0.0:
            words = in_field.reason or f"fewer than {FEWEST_EVENTS:.0f} observations in the field"
            table[name] = entry | _verdict(math.nan, NOT_KNOWN, margin.share, len(field.tally)) | {"note": words}
            continue
        difference = (simulated - in_field.value) / in_field.value
        spread = _spread(value, drives, runs, random, shares_drives=shares_drives)
        interval = NOT_KNOWN
        if spread is not None:
            freedom = spread.freedom(simulated / in_field.value)
            quantile = float(stats.t.ppf(1.0 - ONE_SIDED, freedom))
            interval = fieller_interval(
                simulated, in_field.value, spread.simulated, spread.field, quantile, spread.covariance
            )
        table[name] = entry | _verdict(difference, interval, margin.share, len(field.tally)) | {"note": ""}
    return table


def fieller_interval(
    simulated: float,
    field: float,
    simulated_variance: float,
    field_variance: float,
    quantile: float,
    covariance: float = 0.0,
) -> tuple[float, float]:
    """Return the interval of simulated / field - 1, which knows that the field's value is no more certain than it is.

    A ratio of 1 + m lies in it exactly if simulated - (1 + m) field is no farther from 0 than chance. The variance of
    that is the simulated value's, (1 + m)^2 times the field's, less twice (1 + m) times their covariance. So both
    one-sided tests hold their 5 % at margins of any size, which an interval in units of the field's value does not.

    Args:
        simulated: mean of the rounds.
        field: value of the field, not 0.
        simulated_variance: of that mean.
        field_variance: of that value.
        quantile: of Student's t.
        covariance: of both.

    Returns:
        The interval; nan where the field's value cannot be told from 0.

    Source: Fieller (1954), J. R. Stat. Soc. B 16, 175-185.
    """
    certain = field**2 - quantile**2 * field_variance
    if not (math.isfinite(certain) and certain > 0.0):
        return math.nan, math.nan
    centre = simulated * field - quantile**2 * covariance
    square = centre**2 - certain * (simulated**2 - quantile**2 * simulated_variance)
    reach = math.sqrt(max(square, 0.0))
    return (centre - reach) / certain - 1.0, (centre + reach) / certain - 1.0


@dataclass(frozen=True)
class _Spread:
    """How both sides of a difference scatter.

    What single runs scatter by is in both variances of the simulated value: with few rounds an interval is a little
    wider than it need be.
    """

    of_rounds: float  # variance of the simulated value, rounds drawn anew
    num_rounds: int
    of_drives: float  # variance of the simulated value, drives drawn anew
    field: float  # variance of the field's value
    num_drives: int
    covariance: float  # of both, drives drawn anew

    @property
    def simulated(self) -> float:
        """Variance of the simulated value."""
        return self.of_rounds + self.of_drives

    def freedom(self, ratio: float) -> float:
        """Degrees of freedom of the simulated value less a multiple of the field's."""
        by_drives = max(self.of_drives - 2.0 * ratio * self.covariance + ratio**2 * self.field, 0.0)
        parts = ((self.of_rounds, self.num_rounds - 1), (by_drives, self.num_drives - 1))
        total = self.of_rounds + by_drives
        if not total > 0.0:
            return float(min(freedom for _, freedom in parts))
        return total**2 / sum(variance**2 / freedom for variance, freedom in parts)


def _spread(
    value: Callable[[np.ndarray], float],
    drives: Float[np.ndarray, "drive tally"],
    runs: Float[np.ndarray, "round drive tally"],
    random: np.random.Generator,
    *,
    shares_drives: bool,
) -> _Spread | None:
    """Return how both values scatter; None where one of them alone shows something, which has no scatter."""
    rounds = runs.sum(axis=1)
    for several in (rounds, drives):
        if sum(math.isfinite(value(one)) for one in several) < FEWEST_DRIVES:
            return None
    of_rounds = _drawn(value, rounds, _numbers(len(rounds), random))
    numbers = _numbers(len(drives), random)
    field = _drawn(value, drives, numbers)
    together = _drawn(value, runs.sum(axis=0), numbers) if shares_drives else np.zeros(NUM_DRAWS)
    is_known = np.isfinite(field) & np.isfinite(together)
    # draws of n items scatter by (n - 1) / n less than such items do
    by_rounds, by_drives = (count / (count - 1) for count in (len(rounds), len(drives)))
    covariance = np.cov(together[is_known], field[is_known], bias=True)[0, 1] if is_known.sum() > 1 else 0.0
    return _Spread(
        of_rounds=float(np.nanvar(of_rounds)) * by_rounds,
        num_rounds=len(rounds),
        of_drives=float(np.nanvar(together)) * by_drives,
        field=float(np.nanvar(field)) * by_drives,
        num_drives=len(drives),
        covariance=float(covariance) * by_drives,
    )


def _numbers(count: int, random: np.random.Generator) -> np.ndarray:
    return random.integers(count, size=(NUM_DRAWS, count))


def _drawn(
    value: Callable[[np.ndarray], float], several: Float[np.ndarray, "item tally"], numbers: np.ndarray
) -> Float[np.ndarray, " draw"]:
    return np.asarray([value(tallies) for tallies in several[numbers].sum(axis=1)])


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
