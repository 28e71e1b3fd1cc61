"""Gauss-Newton on response surfaces: `jaxcalib.search.trust_region`, begun anew elsewhere whenever it has converged."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.search import trust_region
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator
from jaxcalib.search.trust_region.evaluated_points import EvaluatedPoints, append_points
from jaxcalib.search.trust_region.records import TrustRegionConfig, TrustRegionState

MANY = 10_000  # iterations; the budget ends the search
# With many parameters the noise of slopes makes whole steps too long, so parts of them are tried as well.
CONFIG = TrustRegionConfig(
    num_iterations=MANY, design="two_level", initial_radius=0.25, step_fractions=(0.3, 0.6, 1.0), least_radius=0.002
)


@dataclass(frozen=True)
class RestartedState:
    """A search, and how many went before."""

    setting: Setting
    search: TrustRegionState
    num_searches: int = 1


class TrustRegion(Optimiser):
    """Uses the residuals, not the accuracy alone."""

    def __init__(self, config: TrustRegionConfig = CONFIG) -> None:
        """Choose options."""
        self._config = config

    def init(self, setting: Setting) -> RestartedState:
        """Return the first state: a search around the start; what is known helps to fit its surfaces."""
        return RestartedState(setting, trust_region.init(setting.start, self._config, _evaluated(setting.known)))

    def ask(self, state: RestartedState) -> Float[np.ndarray, "candidate parameter"]:
        """Return a design or trials."""
        return trust_region.ask(state.search)

    def tell(self, state: RestartedState, told: Told) -> tuple[RestartedState, RoundInfo]:
        """Return the state after a design or trials; a search that has ended begins anew at a random point."""
        weights = np.ones(told.residuals.shape[1])
        search, details = trust_region.tell(state.search, told.residuals, weights, is_ok=told.is_ok)
        # a centre that was never evaluated, or failed, is no answer: a search begins around a random point
        best = details.center if np.isfinite(details.center_misfit) else None
        info = RoundInfo(details.num_failed, details.status, best, details)
        if not search.status.is_final:
            return replace(state, search=search), info
        setting = state.setting
        center = generator(setting.seed, state.num_searches).random(setting.num_parameters)
        search = trust_region.init(center, self._config, _evaluated(setting.known))
        return RestartedState(setting, search, state.num_searches + 1), info


def _evaluated(known: Told | None) -> EvaluatedPoints | None:
    """Return what is known as the search wants it; failed candidates are left out."""
    if known is None or not known.is_ok.any():
        return None
    weights = np.broadcast_to(known.weights[:, None], known.residuals.shape)
    return append_points(None, known.points, known.residuals, weights, known.is_ok)
