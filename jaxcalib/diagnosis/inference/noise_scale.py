"""How wide the noise of a null model is, measured on runs that had no part in it.

Hundreds of features rest on some fifty runs. What keeps their covariance from being too narrow (errors of slopes,
longest tails, floors of counts, a share of independence) is taken in each feature by itself, and together it is three
to four times too wide: squared differences of sets of runs that were left out came to 0.2 to 0.45 of what it says in
the median. With the noise scaled as here, six of seven fields without effect came to 0.69 to 0.93 of what is
expected, and one to 1.41. Errors of slopes make the most of it.

Source: folds as in Stone (1974), J. R. Stat. Soc. B 36, 111-147.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.marginal_likelihood import knees_of, log_density, squeezed

NUM_FOLDS = 5
SETS_PER_FOLD = 40
FEWEST_GROUPS = 5  # runs, or groups of drives that share one: from fewer nothing can be left out


def with_measured_noise(
    null: NullModel, plain: DriveTallies, num_drives: int, build: Callable[[DriveTallies], NullModel]
) -> NullModel:
    """Return a null model whose noise is as wide as runs show that it had no part of.

    Args:
        null: the null model of all runs.
        plain: tallies of these runs, with the null model's features.
        num_drives: drives in the field.
        build: makes the null model of some of the runs.

    Returns:
        The null model with its noise, but not what the parameters' shift adds to it, times one factor. The same one
        where there are fewer than `FEWEST_GROUPS` groups of runs.
    """
    groups = np.arange(len(plain)) if plain.run is None else plain.run
    names = np.unique(groups)
    if len(names) < FEWEST_GROUPS:
        return null
    random = np.random.default_rng(0)
    squares: list[float] = []
    for fold in np.array_split(random.permutation(names), NUM_FOLDS):
        is_out = np.isin(groups, fold)
        rest, out = plain.take(~is_out), plain.take(is_out)
        squares += _left_out(build(rest), rest.num_independent, out, num_drives, random)
    scale = float(np.mean(squares)) / len(null.cells)
    return replace(null, noise=scale * null.noise, covariance=null.covariance + (scale - 1.0) * null.noise)


def _left_out(
    null: NullModel, num_runs: float, out: DriveTallies, num_drives: int, random: np.random.Generator
) -> list[float]:
    """Squared differences of sets of drives that were left out, by the noise, scaled to sets as large as the field.

    In the mean each is as large as the number of features where the noise is right, as evidence judges it. `num_runs`
    independent runs made the null model. A set of all that were left out is drawn once.
    """
    size = min(num_drives, len(out))
    scale = np.sqrt((1.0 / num_drives + 1.0 / num_runs) / (1.0 / size + 1.0 / num_runs))
    squares, knees = [], knees_of(null.cells)
    for _ in range(SETS_PER_FOLD if size < len(out) else 1):
        drawn = out.take(random.permutation(len(out))[:size])
        is_seen = (drawn.below.sum(axis=0) > 0) & np.isfinite(null.mean)
        difference = np.where(is_seen, null.standardised(drawn.values()), 0.0)
        squares.append(log_density(squeezed(scale * difference, knees), null.noise)[1])
    return squares
