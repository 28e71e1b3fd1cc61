"""Chance in made-up fields of several drives: all together, and without each of them, as the verdict looks at them."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.noise import NullModel

NUM_FIELDS = 200  # the same random numbers for all strengths, so that power grows with the strength


@dataclass(frozen=True)
class MadeUpFields:
    """Fields without effect, in units of the null model's noise."""

    covariance: np.ndarray  # of a field of all drives, the parameters' shift in it
    # of each field, of all drives and without each of them in turn, scaled as `scale` says [set, feature, field]
    chance: np.ndarray
    scale: np.ndarray  # by what a set without a drive is scaled down to the noise of all, [set]


def make_fields(null: NullModel, num_drives: int, of_mean: float, num_more: int = 0) -> MadeUpFields:
    """Return fields as the null model says that they are.

    Drives differ from one another by noise of their own; the error of the simulation's mean and the parameters' shift
    are the same for all of them, and more drives do not lessen those.

    Args:
        null: the null model of a field of `num_drives` drives, in whose units the fields are.
        num_drives: drives in the field.
        of_mean: variance of the null model's mean, in units of one drive's.
        num_more: how many drives more than that the made-up fields have.
    """
    number, of_drive = num_drives + num_more, null.noise / (1.0 / num_drives + of_mean)
    of_all = of_drive * of_mean + null.covariance - null.noise
    random = np.random.default_rng(0)
    common = _root(of_all) @ random.standard_normal((len(of_all), NUM_FIELDS))
    own = _root(of_drive) @ random.standard_normal((number, len(of_all), NUM_FIELDS))
    mean, scale = own.mean(axis=0), np.ones(1)
    sets = [common + mean]
    if number > 1:
        to_all = np.sqrt((1.0 / number + of_mean) / (1.0 / (number - 1) + of_mean))
        without = (number * mean - own) / (number - 1)
        sets += list(to_all * (common + without))
        scale = np.append(scale, np.full(number, to_all))
    return MadeUpFields(of_drive / number + of_all, np.stack(sets), scale)


def _root(covariance: np.ndarray) -> np.ndarray:
    """Return a square root; what has no variance, as a mean that is known or parameters that are, stays without."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
