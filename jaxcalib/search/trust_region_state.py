"""Records of the trust-region search: what the next step needs, and what a person wants to see."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.search.evaluated_points import EvaluatedPoints
from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.response_surface import ResponseSurface
from jaxcalib.search.trust_region_config import TrustRegionConfig


@dataclass(frozen=True)
class TrustRegionState:
    """What the next step needs.

    Attributes:
        config: options.
        iteration: pairs of a design and a trial that are finished.
        center: best point known, in the unit cube; the result of the search.
        radius: of the trust region, in each parameter.
        candidates: what is to be evaluated next.
        predicted_improvement: of each trial; None while a design is to be evaluated.
        evaluated: everything told so far; None at the beginning.
        status: where the search stands.
    """

    config: TrustRegionConfig
    iteration: int
    center: Float[np.ndarray, " parameter"]
    radius: float
    candidates: Float[np.ndarray, "candidate parameter"]
    predicted_improvement: Float[np.ndarray, " candidate"] | None
    evaluated: EvaluatedPoints | None
    status: SearchStatus


@dataclass(frozen=True)
class TrustRegionInfo:
    """What a person wants to see about the candidates just told.

    Attributes:
        iteration: its number.
        is_trial: whether they were trials.
        is_accepted: whether the centre moved to a trial.
        ratio: of actual to predicted improvement, noise added to both; nan after a design or if all trials failed.
        actual_improvement: of the misfit, by the best trial; nan as above.
        predicted_improvement: by the best trial, or after a design by the full step.
        center: best point known.
        center_misfit: its misfit; nan if it was never evaluated with success.
        radius: for the next design.
        num_failed: candidates that failed.
        surface: the response surface; None after a trial.
        precision: Gauss-Newton precision of the parameters at the centre, prior included, in coordinates of the unit
            cube; None after a trial.
        status: where the search stands.
    """

    iteration: int
    is_trial: bool
    is_accepted: bool
    ratio: float
    actual_improvement: float
    predicted_improvement: float
    center: Float[np.ndarray, " parameter"]
    center_misfit: float
    radius: float
    num_failed: int
    surface: ResponseSurface | None
    precision: Float[np.ndarray, "parameter parameter"] | None
    status: SearchStatus


def blank_info(state: TrustRegionState, is_counted: Bool[np.ndarray, " candidate"]) -> TrustRegionInfo:
    """Return what is known of a tell before anything is done with it."""
    return TrustRegionInfo(
        iteration=state.iteration,
        is_trial=False,
        is_accepted=False,
        ratio=np.nan,
        actual_improvement=np.nan,
        predicted_improvement=np.nan,
        center=state.center.copy(),
        center_misfit=np.nan,
        radius=state.radius,
        num_failed=int((~is_counted).sum()),
        surface=None,
        precision=None,
        status=state.status,
    )
