"""Uniform random candidates: what every optimiser has to beat."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of


@dataclass(frozen=True)
class RandomState:
    """Which batch comes next."""

    setting: Setting
    batch: int = 0


class RandomSearch(Optimiser):
    """Draws every candidate uniformly."""

    def init(self, setting: Setting) -> RandomState:
        """Return the first state."""
        return RandomState(setting)

    def ask(self, state: RandomState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the next batch."""
        setting = state.setting
        return generator(setting.seed, state.batch).random((setting.batch_size, setting.num_parameters))

    def tell(self, state: RandomState, told: Told) -> tuple[RandomState, RoundInfo]:
        """Return the state of the next batch; what is told changes nothing."""
        return replace(state, batch=state.batch + 1), info_of(told)
