"""The paper's adaptive genetic algorithm, sound and as printed: `jaxcalib.search.saga` as it is."""

import numpy as np
from jaxtyping import Float

from experiments.optimisers.interface import Optimiser, Setting, Told
from jaxcalib.search import SagaConfig, SagaState, saga

POPULATION = 16  # as in `jaxcalib calibrate`


def saga_config(num_evaluations: int, literal: bool) -> SagaConfig:
    """Return the options for a number of evaluations; no accuracy ends the search before."""
    generations = max(1, num_evaluations // POPULATION)
    return SagaConfig(POPULATION, generations, stop_at_threshold=False, literal=literal)


class Saga(Optimiser):
    """SAGA on all parameters."""

    def __init__(self, literal: bool = False) -> None:
        """Choose the reading of Algorithm 3."""
        self._literal = literal

    def init(self, setting: Setting) -> SagaState:
        """Return the first state."""
        config = saga_config(setting.num_evaluations, self._literal)
        return saga.init(setting.num_parameters, setting.seed, setting.start[None], config)

    def ask(self, state: SagaState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the generation."""
        return saga.ask(state)

    def tell(self, state: SagaState, told: Told) -> SagaState:
        """Return the state with the next generation."""
        return saga.tell(state, told.accuracy, told.is_ok)[0]
