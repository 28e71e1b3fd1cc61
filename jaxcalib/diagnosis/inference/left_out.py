"""Drives without any effect, judged by runs that they are not of: how wide noise is, and how far chance goes.

Hundreds of features rest on some fifty drives. What keeps their covariance from being too narrow (errors of slopes,
longest tails, floors of counts, a share of independence) is taken in each feature by itself, and together it is three
to four times too wide; and a few drives of a road that jams now and then are far from normal. Both are measured here
on sets of drives, as many as the field has, by null models of the other runs: the noise is scaled by one factor, and
the sets are kept, for evidence to be held against theirs.

Source: repeated random splits, Picard and Cook (1984), J. Am. Stat. Assoc. 79, 575-583.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.marginal_likelihood import knees_of, log_densities, squeezed

NUM_SPLITS = 10
SETS_PER_SPLIT = 6
FEWEST_RUNS = 5  # runs, or groups of drives that share one: from fewer nothing can be left out


@dataclass(frozen=True)
class LeftOut:
    """Some sets of drives without effect, and the null model of the runs that they are not of."""

    null: NullModel
    # [set, 1 + drive, feature] in units of that one's noise, scaled to as many drives as the field has: of all drives
    # of a set, and without each of them
    differences: np.ndarray


def left_out_sets(
    plain: DriveTallies, num_drives: int, build: Callable[[DriveTallies], NullModel]
) -> tuple[LeftOut, ...]:
    """Return sets of drives that are left out, each drive of a run of its own.

    A set has as many drives as the field, or half of the runs where these are fewer.

    Args:
        plain: tallies of drives without effect, with the null model's features.
        num_drives: drives in the field.
        build: makes the null model of some of them.

    Returns:
        One for each split of the runs; none where there are fewer than `FEWEST_RUNS`.
    """
    groups = np.arange(len(plain)) if plain.run is None else plain.run
    names = np.unique(groups)
    if len(names) < FEWEST_RUNS:
        return ()
    random = np.random.default_rng(0)
    size = min(num_drives, len(names) // 2)
    splits = []
    for _ in range(NUM_SPLITS):
        out = random.permutation(names)[:size]
        rest = plain.take(~np.isin(groups, out))
        null, of_mean = build(rest), 1.0 / rest.num_independent
        to_field = np.sqrt((1.0 / num_drives + of_mean) / (1.0 / size + of_mean))
        sets = [
            differences_of(plain.take(np.asarray([random.choice(np.flatnonzero(groups == each)) for each in out])),
                           null, of_mean)
            for _ in range(SETS_PER_SPLIT)
        ]  # fmt: skip
        splits.append(LeftOut(null, to_field * np.stack(sets)))
    return tuple(splits)


def noise_factor(left_out: Sequence[LeftOut]) -> float:
    """Return by what noise has to be multiplied, so that sets that were left out scatter by it; 1 where none were.

    By it scatters the one in the middle: what few sets have, a jam, would blur all others, and is left to the evidence
    that they have by chance.
    """
    squares: list[float] = []
    for each in left_out:
        judged = squeezed(each.differences[:, 0], knees_of(each.null.cells))
        squares += (log_densities(judged, each.null.noise)[1] / len(each.null.cells)).tolist()
    return float(np.median(squares)) if squares else 1.0


def with_noise(null: NullModel, factor: float) -> NullModel:
    """Return a null model whose noise, but not what the parameters' shift adds to it, is multiplied by a factor."""
    return replace(null, noise=factor * null.noise, covariance=null.covariance + (factor - 1.0) * null.noise)


def differences_of(drives: DriveTallies, null: NullModel, of_mean: float) -> np.ndarray:
    """Return the difference of all drives, and without each of them in turn, [1 + drive, feature].

    In units of noise, and scaled to as many drives as there are: what fewer of them scatter by more is taken off.
    Features that are not shown count as they are expected.

    Args:
        drives: tallies of the null model's features.
        null: the null model.
        of_mean: variance of its mean, in units of one drive's.
    """
    size, rows = len(drives), []
    for some in [drives, *(drives.without_each() if size > 1 else [])]:
        to_all = np.sqrt((1.0 / size + of_mean) / (1.0 / len(some) + of_mean))
        difference = null.standardised(some.values())
        is_shown = (some.below.sum(axis=0) > 0) & np.isfinite(difference)
        rows.append(np.where(is_shown, to_all * difference, 0.0))
    return np.stack(rows)
