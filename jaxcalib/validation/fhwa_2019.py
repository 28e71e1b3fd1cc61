"""The four criteria of FHWA's update of 2019: one simulated day within what days of one kind differ by.

Source: Wunderlich, Vasudevan & Wang (2019), Traffic Analysis Toolbox Volume III, FHWA-HOP-18-036, chapter 5.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.validation.criterion import FHWA_2019, Criterion, at_least, at_most

FEWEST_DAYS = 3
OUTER_SIGMAS, INNER_SIGMAS = 1.96, 1.0
OUTER_SHARE, INNER_SHARE = 0.95, 2.0 / 3.0
SYSTEMATIC_SHARE = 1.0 / 3.0


@dataclass(frozen=True)
class DayEnvelope:
    """What days of one kind show of a quantity over time."""

    representative: int  # number of the day that is nearest to the mean of all
    observed: Float[np.ndarray, " interval"]  # that day's values
    sigma: Float[np.ndarray, " interval"]  # standard deviation over days in each interval
    bdae_threshold: float  # bounded dynamic absolute error: mean absolute difference of that day from the others


def day_envelope(days: Float[np.ndarray, "day interval"]) -> DayEnvelope:
    """Return the envelope of at least three days."""
    mean = days.mean(axis=0)
    scale = np.where(mean > 0.0, mean, 1.0)
    representative = int(np.argmin(np.mean(np.abs(days - mean) / scale, axis=1)))
    observed = days[representative]
    others = np.delete(days, representative, axis=0)
    return DayEnvelope(representative, observed, days.std(axis=0, ddof=1), float(np.mean(np.abs(others - observed))))


def criteria_2019(
    days: Float[np.ndarray, "day interval"], simulated: Float[np.ndarray, " interval"], what: str
) -> list[Criterion]:
    """Return the four criteria for one quantity at one place, from at least three observed days and a simulated one."""
    envelope = day_envelope(days)
    difference = simulated - envelope.observed
    note = f"{len(days)} days, {len(simulated)} intervals; representative day {envelope.representative + 1}"
    shares = [float(np.mean(np.abs(difference) <= sigmas * envelope.sigma)) for sigmas in (OUTER_SIGMAS, INNER_SIGMAS)]
    return [
        at_least(f"I, share of intervals within 1.96 sigma: {what}", FHWA_2019, shares[0], OUTER_SHARE, note),
        at_least(f"II, share of intervals within 1 sigma: {what}", FHWA_2019, shares[1], INNER_SHARE, note),
        at_most(
            f"III, bounded dynamic absolute error: {what}", FHWA_2019,
            float(np.mean(np.abs(difference))), envelope.bdae_threshold, note,
        ),
        at_most(
            f"IV, bounded dynamic systematic error: {what}", FHWA_2019,
            abs(float(np.mean(difference))), SYSTEMATIC_SHARE * envelope.bdae_threshold, note,
        ),
    ]  # fmt: skip
