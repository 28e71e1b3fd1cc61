"""What the surrogate's moments lack against SUMO's, learnt from the SUMO runs that were made to confirm candidates."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from jaxcalib.calibration.objective.moments import Moments

LENGTH_SCALE = 1.0  # in the unit cube: both simulators share their rules, so what differs varies slowly
AMPLITUDE_BOUNDS = (1e-3, 1e2)  # variance of the discrepancy in units of the field's noise variance


@dataclass(frozen=True)
class Confirmed:
    """One candidate in both simulators, on the same drives."""

    unit: Float[np.ndarray, " parameter"]  # in the unit cube
    surrogate: Float[np.ndarray, " tally"]  # pooled tallies
    surrogate_runs: int  # runs behind them
    sumo: Float[np.ndarray, " tally"]  # pooled tallies
    sumo_runs: float  # independent runs that tell as much as those behind them


@dataclass(frozen=True)
class LearntDiscrepancy:
    """A Gaussian process over the unit cube, one output per moment, one kernel for all.

    Moments count in units of their noise, so that the kernel's amplitude, found by maximum likelihood over all of
    them, says how large the discrepancy is beyond the noise of the runs it was learnt from.

    Source: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63: discrepancy as a Gaussian process of known noise.
    """

    process: GaussianProcessRegressor
    deviation: Float[np.ndarray, " moment"]
    last: Float[np.ndarray, " parameter"]

    def predict(self, unit: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, "candidate moment"]:
        """Return what SUMO's moments exceed the surrogate's by."""
        return np.asarray(self.process.predict(unit)).reshape(len(unit), -1) * self.deviation

    def variance(self) -> Float[np.ndarray, " moment"]:
        """Return the variance of that at the last confirmed candidate."""
        _, error = self.process.predict(self.last[None], return_std=True)
        return (np.asarray(error).reshape(-1) * self.deviation) ** 2

    @property
    def amplitude(self) -> float:
        """Typical size of the discrepancy in units of the field's noise."""
        kernel: Any = self.process.kernel_  # a Product; scikit-learn has no annotations
        return float(np.sqrt(kernel.k1.constant_value))


def learn_discrepancy(
    moments: Moments, covariance: Float[np.ndarray, "moment moment"], num_drives: float, confirmed: list[Confirmed]
) -> LearntDiscrepancy:
    """Learn the discrepancy.

    Args:
        moments: what is matched.
        covariance: of the moments of one run.
        num_drives: drives behind the field's values; their noise is the unit.
        confirmed: candidates that both simulators have run.
    """
    deviation = np.sqrt(np.diag(covariance) / num_drives)
    difference = np.stack([moments.values(one.sumo) - moments.values(one.surrogate) for one in confirmed]) / deviation
    difference = np.nan_to_num(difference)  # a moment that one of them never observed says nothing
    noise = np.asarray([num_drives * (1.0 / one.sumo_runs + 1.0 / one.surrogate_runs) for one in confirmed])
    kernel = ConstantKernel(1.0, AMPLITUDE_BOUNDS) * RBF(LENGTH_SCALE, "fixed")
    process = GaussianProcessRegressor(
        kernel,
        alpha=noise,  # pyright: ignore[reportArgumentType]  # one per point is allowed too
        normalize_y=False,
        random_state=0,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # an amplitude at its bound is what the bound is for
        process.fit(np.stack([one.unit for one in confirmed]), difference)
    return LearntDiscrepancy(process, deviation, confirmed[-1].unit)
