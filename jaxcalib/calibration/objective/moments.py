"""The measures that a calibration matches, as one vector, with the noise that seeds and drives leave on it."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from sklearn.covariance import LedoitWolf

from jaxcalib.errors import CaseError, quote
from jaxcalib.measures.measure import Level, Measure

FEWEST_EVENTS = 5.0  # in all drives to fit together, of what is counted per drive or over a distance
FEWEST_OBSERVATIONS = 30.0  # in all drives to fit together; fewer say nothing of a mean
FEWEST_EFFECTIVE_DRIVES = 3.5


@dataclass(frozen=True)
class Moments:
    """Quotients of tallies, as one vector."""

    names: tuple[str, ...]  # names of the measures
    levels: tuple[Level, ...]  # what each describes
    numerator: np.ndarray  # place of each numerator among the tallies
    denominator: np.ndarray  # place of each denominator
    scale: np.ndarray  # factor of each
    drives: int  # place of the number of drives among the tallies
    # names of those that are events over a distance: their events count, not the metres
    rates: frozenset[str] = frozenset()

    def values(self, tally: Float[np.ndarray, "... tally"]) -> Float[np.ndarray, "... moment"]:
        """Return the moments of pooled tallies; nan where nothing was observed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            values = self.scale * tally[..., self.numerator] / tally[..., self.denominator]
        return np.where(tally[..., self.denominator] > 0.0, values, np.nan)

    @property
    def is_per_drive(self) -> Bool[np.ndarray, " moment"]:
        """Whether each counts events in a drive."""
        return self.denominator == self.drives

    def influence(self, tally: Float[np.ndarray, "run tally"]) -> Float[np.ndarray, "run moment"]:
        """Influence of each run on the moments of all runs (delta method); its mean over runs is 0."""
        mean = tally.mean(axis=0)
        value = self.values(mean)
        above, below = self.scale * tally[:, self.numerator], tally[:, self.denominator]
        return (above - value * below) / mean[self.denominator]

    def take(self, chosen: np.ndarray) -> "Moments":
        """Return some of the moments."""
        index = np.arange(len(self.names))[chosen]
        return replace(
            self,
            names=tuple(self.names[i] for i in index),
            levels=tuple(self.levels[i] for i in index),
            numerator=self.numerator[index],
            denominator=self.denominator[index],
            scale=self.scale[index],
        )


def all_moments(
    measures: Mapping[str, Measure], tally_index: Mapping[str, int], further: Sequence[str] = ()
) -> Moments:
    """All measures that the default objective matches, and further ones by name.

    Raises:
        CaseError: there is no such measure, or it is none that can be matched.
    """
    can = [name for name, measure in measures.items() if measure.is_quotient]
    for name in further:
        if name not in can:
            near = ", ".join(difflib.get_close_matches(name, can, n=3) or can[:3])
            why = "it is no mean, rate or share" if name in measures else "there is none of that name"
            raise CaseError("settings", "also_match", f"expected measures such as {near}; got {quote(name)}: {why}.")
    chosen = [measure for measure in measures.values() if measure.is_matched or measure.name in further]
    return moments_of(chosen, tally_index)


def moments_of(measures: Sequence[Measure], tally_index: Mapping[str, int]) -> Moments:
    """Return measures as a vector."""
    return Moments(
        names=tuple(measure.name for measure in measures),
        levels=tuple(measure.level for measure in measures),
        numerator=np.asarray([tally_index[measure.numerator] for measure in measures], int),
        denominator=np.asarray([tally_index[measure.denominator] for measure in measures], int),
        scale=np.asarray([measure.scale for measure in measures], float),
        drives=tally_index["drives"],
        rates=frozenset(measure.name for measure in measures if measure.is_rate),
    )


def observed_moments(
    moments: Moments,
    field: Float[np.ndarray, "drive tally"],
    simulated: Float[np.ndarray, "run tally"],
    *,
    on_both_sides: bool = False,
) -> Moments:
    """Return the moments that both the field and the simulation observe often enough; of events, that one of them does.

    Args:
        moments: to choose from.
        field: tallies of the field's drives.
        simulated: tallies of runs near where the search begins.
        on_both_sides: whether both must show events, as relative errors need.
    """
    per_run = field[:, moments.drives].sum() / len(simulated)
    sums = field.sum(axis=0), per_run * simulated.sum(axis=0)
    is_per_drive = moments.is_per_drive
    is_rate = np.asarray([name in moments.rates for name in moments.names], bool)
    # that one side shows no event where the other shows many says something; that neither shows any does not
    shown = (np.minimum if on_both_sides else np.maximum)(*(tally[moments.numerator] for tally in sums))
    enough = ~(is_rate | is_per_drive) | (shown >= FEWEST_EVENTS)
    for tally in sums:
        enough &= is_per_drive | (tally[moments.denominator] >= FEWEST_OBSERVATIONS)
    for drives in (field, simulated):  # a mean that rests on one or two drives has no noise that could be estimated
        weight = drives[:, moments.denominator]
        num_effective = weight.sum(axis=0) ** 2 / np.maximum((weight**2).sum(axis=0), 1e-12)
        enough &= num_effective >= min(FEWEST_EFFECTIVE_DRIVES, 0.8 * len(drives))
    spread = np.nan_to_num(moments.influence(simulated)).std(axis=0)
    return moments.take(enough & (is_per_drive | (spread > 0.0)))  # a count that is always 0 has the field's noise


def noise_covariance(
    moments: Moments, simulated: Float[np.ndarray, "run tally"], field: Float[np.ndarray, " moment"] | None = None
) -> Float[np.ndarray, "moment moment"]:
    """Return the covariance of the moments of one run; that of n pooled runs is an n-th of it.

    The variance of a count is in proportion to its mean and at least that, as Poisson's. Where the field shows more of
    it than the runs, what its variance is more is added: runs with one event would be sure that there is none.

    Args:
        moments: what is matched.
        simulated: tallies of runs.
        field: the field's moments, if they are known.

    Source: influence of single runs (delta method for ratios of means), shrunk towards uncorrelated moments by
    Ledoit & Wolf (2004), J. Multivariate Anal. 88, as scikit-learn has it, since runs are hardly more than moments.
    """
    influence = moments.influence(simulated)
    deviation = influence.std(axis=0, ddof=1)
    correlation = (
        LedoitWolf(assume_centered=True).fit(influence / np.where(deviation > 0.0, deviation, 1.0)).covariance_
    )
    covariance = correlation * np.outer(deviation, deviation)
    if field is None:
        return covariance
    usual, variance = moments.values(simulated.sum(axis=0)), deviation**2
    with np.errstate(divide="ignore", invalid="ignore"):
        in_proportion = np.where(usual > 0.0, variance * field / usual, 0.0)
    in_field = np.maximum(in_proportion, moments.scale * field)
    return covariance + np.diag(np.where(moments.is_per_drive, np.maximum(in_field - variance, 0.0), 0.0))
