"""How far a candidate is from the field: residuals in units of their noise, and one accuracy."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.evidence import Evidence
from jaxcalib.calibration.objective.moments import Moments
from jaxcalib.measures.measure import Level

NEVER_SHOWN = 1.0  # relative error of a quantity that the field shows and the simulation never
MODEL_ERROR = 0.02  # relative; before it is measured, no simulator is taken to be closer to another than that


class Discrepancy(Protocol):
    """What a simulator's moments lack, learnt from runs of another one."""

    def predict(self, unit: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, "candidate moment"]:
        """What is to be added to the moments at each point of the unit cube."""
        ...

    def variance(self) -> Float[np.ndarray, " moment"]:
        """Variance of that, of each moment."""
        ...


@dataclass(frozen=True)
class Objective:
    """Distance to the field.

    Residuals are whitened: moments that vary together count together, and each independent combination counts in
    units of its own standard deviation over drives and seeds. So a misfit of 1 per moment is what the true parameters
    show. The paper's Eqs. 2 and 11 divide each error by the field's value instead, so that the noisiest measure rules;
    `is_relative` chooses them.
    """

    moments: Moments  # what is matched
    field: Float[np.ndarray, " moment"]  # their values in the field
    covariance: Float[np.ndarray, "moment moment"]  # of the moments of one run
    usual: Float[np.ndarray, " moment"]  # their values in the runs behind that
    num_drives: float  # drives behind the field's values
    # what is known of the parameters themselves; a measurement like the moments, and weighed like them
    evidence: Evidence
    discrepancy: Discrepancy | None = None  # correction of the simulator; None before it is known
    is_relative: bool = False  # whether residuals are relative errors, as in Eqs. 2 and 11, instead of whitened ones.
    is_summed: bool = False  # whether relative errors are added up as printed, instead of averaged

    def residuals(
        self,
        unit: Float[np.ndarray, "candidate parameter"],
        pooled: Float[np.ndarray, "candidate tally"],
        num_runs: float,
    ) -> Float[np.ndarray, "candidate residual"]:
        """Return whitened residuals, simulated less field, then those of the evidence.

        A candidate that failed gets nan. A moment that its runs never show, as a rare one in a few drives, says neither
        for nor against it: the usual value stands for it.

        Args:
            unit: candidates in the unit cube.
            pooled: their pooled tallies.
            num_runs: runs behind each.
        """
        simulated = self.moments.values(pooled)
        has_failed = ~np.isfinite(pooled).any(axis=1, keepdims=True)
        if not self.is_relative:
            simulated = np.where(np.isnan(simulated) & ~has_failed, self.usual, simulated)
        if self.discrepancy is not None:
            simulated = simulated + self.discrepancy.predict(unit)
        if self.is_relative:
            errors = np.nan_to_num((simulated - self.field) / self.field, nan=NEVER_SHOWN)
            return np.where(has_failed, np.nan, errors)
        factor = np.linalg.cholesky(self.variance(num_runs))
        whitened = np.linalg.solve(factor, (simulated - self.field).T).T
        return np.concatenate([whitened, self.evidence.residuals(unit)], axis=1)

    def variance(self, num_runs: float) -> Float[np.ndarray, "moment moment"]:
        """Return the covariance of simulated less field moments at the true parameters."""
        noise = self.covariance * (1.0 / self.num_drives + 1.0 / num_runs)
        if self.discrepancy is None:
            return noise + np.diag((MODEL_ERROR * self.field) ** 2)
        return noise + np.diag(self.discrepancy.variance())

    def accuracy(self, residuals: Float[np.ndarray, "candidate residual"]) -> Float[np.ndarray, " candidate"]:
        """Return 1 less the typical relative error of the moments; at most 1.

        The root mean square of the whitened residuals times the typical relative noise: what Eqs. 3 and 9 call
        accuracy, with the mean in place of the sum over measures, and each error weighted by how well it is known.
        """
        if self.is_relative:
            gather = np.sum if self.is_summed else np.mean
            return 1.0 - gather(np.abs(residuals), axis=1)
        return 1.0 - self.relative_noise * np.sqrt(np.mean(residuals**2, axis=1))

    @property
    def relative_noise(self) -> float:
        """Median over the moments of the relative standard deviation over drives."""
        deviation = np.sqrt(np.diag(self.covariance) / self.num_drives)
        is_nonzero = self.field != 0.0
        return float(np.median(deviation[is_nonzero] / np.abs(self.field[is_nonzero])))

    @property
    def noise_floor_accuracy(self) -> float:
        """Accuracy that the true parameters show on average."""
        return 1.0 - self.relative_noise

    def of_simulator(self) -> "Objective":
        """Return the objective of a simulator as it is, without a correction by another one."""
        return replace(self, discrepancy=None)

    def take(self, chosen: np.ndarray) -> "Objective":
        """Return the objective on some of its moments."""
        if self.discrepancy is not None:
            raise ValueError("Choose moments before a discrepancy is learnt.")
        return replace(
            self,
            moments=self.moments.take(chosen),
            field=self.field[chosen],
            covariance=self.covariance[np.ix_(chosen, chosen)],
            usual=self.usual[chosen],
        )

    def of_level(self, level: Level) -> "Objective":
        """Return the objective on the moments of one level."""
        return self.take(np.asarray([own is level for own in self.moments.levels]))
