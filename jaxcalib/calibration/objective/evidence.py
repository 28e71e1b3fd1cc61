"""What is known of the parameters beside the measures of the traffic, weighed like them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.initial_values.demand_profile import demand_covariance
from jaxcalib.initial_values.initial_point import InitialPoint

# The scenario's value is somebody's guess: one standard deviation is a factor of 3 for most driver parameters. Without
# it, what the measures cannot tell ends up wherever their noise points.
SCENARIO_ERROR = 0.25  # of the unit range


@dataclass(frozen=True)
class Evidence:
    """Residuals that are linear in the parameters, each with a standard deviation of 1 at the true ones."""

    unit: Float[np.ndarray, " parameter"]  # most probable values in the unit cube
    whitener: Float[np.ndarray, "known parameter"]  # residuals per departure from them

    def residuals(self, unit: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, "candidate known"]:
        """Return departures from the most probable values."""
        return (unit - self.unit) @ self.whitener.T


def independent_evidence(unit: Float[np.ndarray, " parameter"], error: Float[np.ndarray, " parameter"]) -> Evidence:
    """Return evidence from standard errors; parameters whose error is inf are not known."""
    known = np.isfinite(error)
    return Evidence(unit, np.diag(1.0 / np.where(known, error, 1.0))[known])


def evidence_of(initial: InitialPoint) -> Evidence:
    """Evidence on inputs and driver parameters.

    Driver parameters: what the leader-follower pairs and the accepted gaps of the logs say; where they are silent, the
    scenario's values. Inputs: the scenario's values, a common factor less certain than the shares. What the logs say of
    the inputs, the volume along the route, is among the measures, and would count twice.
    """
    space, num_inputs = initial.space, len(initial.demand.values_vehph)
    unit = space.unit_of(initial.values)
    width = (space.upper - space.lower)[:num_inputs]
    unit[:num_inputs] = (initial.demand.scenario_vehph - space.lower[:num_inputs]) / width
    error = initial.unit_error[num_inputs:]
    covariance = np.zeros((len(unit), len(unit)))
    covariance[:num_inputs, :num_inputs] = demand_covariance(initial.demand) / np.outer(width, width)
    drivers = np.arange(num_inputs, len(unit))
    covariance[drivers, drivers] = np.where(np.isfinite(error), error, SCENARIO_ERROR) ** 2
    return Evidence(unit, np.linalg.inv(np.linalg.cholesky(covariance)))
