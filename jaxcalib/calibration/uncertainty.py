"""How well the data know each parameter at the result."""

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.local_surface import local_surface
from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.search_box import search_box

LEAST_EIGENVALUE = 1e-3  # of the information; what is known less well counts as not known


def parameter_errors(record: CalibrationRecord) -> Float[np.ndarray, " parameter"]:
    """Return the standard error of each parameter in the unit cube; inf where the data say nothing.

    Gauss-Newton: a response surface through all candidates near the result gives the sensitivity of the whitened
    residuals, whose squares add up to the information on the parameters. Residuals are in units of their noise, field
    and model error included, and the logs' own evidence is among them.

    Source: Nocedal & Wright, Numerical Optimization, ch. 10; parameters whose profile is flat get a wide interval.
    """
    objective, space = record.confirmation.objective, record.initial.space
    if objective.is_relative:  # relative errors have no noise that an error could follow from
        return np.full(len(space.names), np.inf)
    box = search_box(record.confirmation.best, range(len(space.names)), record.found.half_width)
    surface = local_surface(objective, box, record.found.judged, record.confirmation.best)
    jacobian = surface.slope / (surface.radius * (box.upper - box.lower))
    information = jacobian.T @ jacobian
    variance = np.diag(np.linalg.pinv(information, rcond=LEAST_EIGENVALUE**2, hermitian=True))
    is_known = (np.diag(information) > 1.0) & (variance > 0.0)  # an error of more than the whole range is no knowledge
    return np.where(is_known, np.sqrt(np.maximum(variance, 0.0)), np.inf)
