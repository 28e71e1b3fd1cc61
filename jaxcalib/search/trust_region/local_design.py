"""Candidates around a centre from which a local response surface can be fitted."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from jaxcalib.search.orthogonal_arrays.orthogonal_array import orthogonal_array


def local_design(
    center: Float[np.ndarray, " parameter"],
    radius: float,
    kind: Literal["central", "two_level"],
    iteration: int,
) -> Float[np.ndarray, "candidate parameter"]:
    """Return the centre and the candidates around it, all in the unit cube.

    "central" moves one parameter at a time by the radius in both directions: 2 M candidates. "two_level" moves all
    parameters at once by plus or minus the radius as a two-level orthogonal array says: about M candidates, and
    slopes of much smaller variance, but main effects aliased with interactions; from one iteration to the next signs
    are folded over and columns rotated, so that other interactions are aliased.

    Where the centre is closer to a bound than the radius, the design around it is moved inwards as a whole.

    Args:
        center: in the unit cube.
        radius: in (0, 0.5].
        kind: "central" or "two_level".
        iteration: >= 0.

    Raises:
        ValueError: unknown kind.

    Source: Box & Draper, Response Surfaces, ch. 4-5 (two-level designs, fold-over).
    """
    num_parameters = center.shape[0]
    if kind == "central":
        signs = np.vstack([np.eye(num_parameters), -np.eye(num_parameters)])
    elif kind == "two_level":
        signs = 2.0 * orthogonal_array(num_parameters, 2).levels - 1.0
        signs = np.roll(signs, iteration // 2, axis=1) * (-1.0) ** iteration
    else:
        raise ValueError(f"Expected a design among ('central', 'two_level'); got {kind!r}.")
    design_center = np.clip(center, radius, 1.0 - radius)
    return np.clip(np.vstack([center, design_center + radius * signs]), 0.0, 1.0)
