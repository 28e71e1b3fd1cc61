"""How well the data know each parameter at the result."""

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.stages.local_surface import local_surface
from jaxcalib.calibration.stages.search_box import search_box
from jaxcalib.search.least_squares.response_surface import ResponseSurface

LEAST_EIGENVALUE = 1e-3  # of the information; what is known less well counts as not known


def parameter_errors(record: CalibrationRecord) -> Float[np.ndarray, " parameter"]:
    """Return the standard error of each parameter in the unit cube; inf where the data say nothing.

    Gauss-Newton: a response surface through all candidates near the result, or where the surrogate drives as SUMO does
    there, gives the sensitivity of the whitened residuals, whose squares add up to the information on the parameters.
    Residuals are in units of their noise, field and model error included, and the logs' own evidence is among them.

    Slopes that are noise would count as knowledge, and with many parameters most of what they add up to is noise. So
    what their errors add up to on average is taken off; no direction ends up with less than nothing.

    Source: Nocedal & Wright, Numerical Optimization, ch. 10; parameters whose profile is flat get a wide interval. The
    correction is that of errors in variables: Fuller (1987), Measurement Error Models, ch. 2.2. Where the result leaves
    more in SUMO than noise does, something is wrong that no noise stands for, and the moments know as much less: the
    ratio of Birge (1932), Phys. Rev. 40, 207, never below 1.
    """
    objective, space = record.confirmation.objective, record.initial.space
    if objective.is_relative:  # relative errors have no noise that an error could follow from
        return np.full(len(space.names), np.inf)
    confirmation = record.confirmation
    center, judged = confirmation.best_in_surrogate, [*record.found.judged, *confirmation.judged]
    box = search_box(center, range(len(space.names)), record.found.half_width)
    surface = local_surface(objective, box, judged, center)
    best = confirmation.finalists[confirmation.winner]
    excess = birge_ratio(best.accuracy, objective.relative_noise)
    per_step = information_of(surface, len(objective.moments.names), excess)
    information = per_step / np.outer(*[surface.radius * box.width] * 2)
    variance = np.diag(np.linalg.pinv(information, rcond=LEAST_EIGENVALUE**2, hermitian=True))
    is_known = (np.diag(information) > 1.0) & (variance > 0.0)  # an error of more than the whole range is no knowledge
    return np.where(is_known, np.sqrt(np.maximum(variance, 0.0)), np.inf)


def birge_ratio(accuracy: float, relative_noise: float) -> float:
    """Return the root mean square of residuals in units of their noise behind an accuracy; 1 where it is less."""
    return max(1.0, (1.0 - accuracy) / relative_noise)


def information_of(
    surface: ResponseSurface, num_moments: int, excess: float = 1.0
) -> Float[np.ndarray, "parameter parameter"]:
    """Return the information on the parameters in a surface's slopes, per unit of its steps.

    Args:
        surface: of whitened residuals.
        num_moments: residuals of noisy moments; those behind them are the logs' evidence, whose slopes are exact.
        excess: by how much more than their noise moments are off in the mean; the logs' evidence is not asked.
    """
    moments, evidence = surface.slope[:num_moments], surface.slope[num_moments:]
    noise = np.sum(surface.slope_covariance[:num_moments], axis=0)
    known = np.zeros_like(noise)
    if np.isfinite(noise).all():
        value, vector = np.linalg.eigh(moments.T @ moments - noise)
        known = (vector * np.maximum(value, 0.0)) @ vector.T
    return known / excess**2 + evidence.T @ evidence
