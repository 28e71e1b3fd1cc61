"""Which driver parameters Stage 2 searches, and where the others stay meanwhile."""

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.stages.screening import Screening


def critical_parameters(exploration: Screening, num_critical: int, num_inputs: int) -> np.ndarray:
    """Return the places of the critical driver parameters among all; inputs, screened beside them, are left out."""
    ranked = exploration.box.chosen[exploration.ranges.critical_parameters]
    return ranked[ranked >= num_inputs][:num_critical]


def hold_others(exploration: Screening, start: Float[np.ndarray, " parameter"], critical: np.ndarray) -> np.ndarray:
    """Return the point whose critical parameters are searched: they begin where the exploration ended.

    A parameter that is not critical keeps what the logs or the scenario say, unless its best level stands out from
    noise. (The paper does not say; the best level of a parameter without effect is a random one.)
    """
    held = start.copy()
    held[critical] = exploration.best[critical]
    noise = exploration.ranges.noise
    levels = exploration.box.unit_of(exploration.ranges.best_levels[None] / (exploration.array.num_levels - 1))[0]
    for place, parameter in enumerate(exploration.box.chosen):
        stands_out = noise is not None and not noise.is_indistinguishable[place]
        if parameter not in critical and stands_out:
            held[parameter] = levels[parameter]
    return held
