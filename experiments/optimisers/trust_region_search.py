"""Gauss-Newton on response surfaces: `jaxcalib.search.trust_region`, begun anew elsewhere whenever it has converged."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from experiments.optimisers.interface import Optimiser, Setting, Told, generator
from jaxcalib.search import TrustRegionConfig, TrustRegionState, trust_region

MANY = 10_000  # iterations; the budget ends the search
# As in the polish of `jaxcalib calibrate`, but for the radius: here nothing was searched before.
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

    def init(self, setting: Setting) -> RestartedState:
        """Return the first state: a search around the start."""
        return RestartedState(setting, trust_region.init(setting.start, CONFIG))

    def ask(self, state: RestartedState) -> Float[np.ndarray, "candidate parameter"]:
        """Return a design or trials."""
        return trust_region.ask(state.search)

    def tell(self, state: RestartedState, told: Told) -> RestartedState:
        """Return the state after a design or trials; a search that has ended begins anew at a random point."""
        weights = np.ones(told.residuals.shape[1])
        search, _ = trust_region.tell(state.search, told.residuals, weights, is_ok=told.is_ok)
        if not search.status.is_final:
            return replace(state, search=search)
        setting = state.setting
        center = generator(setting.seed, state.num_searches).random(setting.num_parameters)
        return RestartedState(setting, trust_region.init(center, CONFIG), state.num_searches + 1)
