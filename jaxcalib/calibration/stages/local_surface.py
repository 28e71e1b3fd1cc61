"""The response of the whitened residuals around a point, from every candidate that was run near it."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.stages.search_box import SearchBox
from jaxcalib.calibration.stages.search_run import Judged
from jaxcalib.search.least_squares.response_surface import ResponseSurface, fit_response_surface

RADIUS = 0.5  # of the box: the whole of it
NOISELESS_RUNS = 100_000  # the noise of single candidates averages out over the surface


def local_surface(
    objective: Objective, box: SearchBox, judged: Sequence[Judged], center: Float[np.ndarray, " parameter"]
) -> ResponseSurface:
    """Return a linear response surface through the candidates in a box.

    Args:
        objective: by which their residuals count.
        box: where to look.
        judged: candidates; those outside the box are left out, the others weigh by their runs.
        center: of the surface, in the unit cube.
    """
    points, residuals, weights = [], [], []
    for one in judged:
        at = objective.residuals(one.unit, one.pooled, NOISELESS_RUNS)
        chosen = box.holds(one.unit) & np.isfinite(at).all(axis=1)
        points.append(box.box_of(one.unit)[chosen])
        residuals.append(at[chosen])
        weights.append(np.full((int(chosen.sum()), at.shape[1]), float(one.num_runs)))
    return fit_response_surface(
        np.vstack(points), np.vstack(residuals), np.vstack(weights), box.box_of(center[None])[0], RADIUS
    )
