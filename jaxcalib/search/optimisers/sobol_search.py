"""Candidates of a scrambled Sobol sequence: evenly spread, whatever they show."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of


@dataclass(frozen=True)
class SobolState:
    """Which part of the sequence comes next."""

    setting: Setting
    num_asked: int = 0


class SobolSearch(Optimiser):
    """Takes the points of a sequence in turn (SciPy's, scrambled)."""

    def init(self, setting: Setting) -> SobolState:
        """Return the first state."""
        return SobolState(setting)

    def ask(self, state: SobolState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the next points of the sequence."""
        setting = state.setting
        size = 2 ** int(np.ceil(np.log2(state.num_asked + setting.batch_size)))  # the sequence is even in powers of 2
        sequence = qmc.Sobol(setting.num_parameters, rng=generator(setting.seed)).random(size)
        return sequence[state.num_asked : state.num_asked + setting.batch_size]

    def tell(self, state: SobolState, told: Told) -> tuple[SobolState, RoundInfo]:
        """Return the state further on; what is told changes nothing."""
        return replace(state, num_asked=state.num_asked + len(told.points)), info_of(told)
