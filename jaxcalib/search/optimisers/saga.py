"""The paper's adaptive genetic algorithm, sound and as printed: `jaxcalib.search.saga` as it is."""

import numpy as np
from jaxtyping import Float

from jaxcalib.search import saga
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told
from jaxcalib.search.saga.config import SagaConfig
from jaxcalib.search.saga.search import SagaState

POPULATION = 16


class Saga(Optimiser):
    """SAGA; its elites must prove themselves on the random numbers of each generation."""

    compares_rounds = False

    def __init__(self, literal: bool = False) -> None:
        """Choose the reading of Algorithm 3."""
        self._literal = literal

    def init(self, setting: Setting) -> SagaState:
        """Return the first state: the starts and a Latin hypercube."""
        generations = setting.num_evaluations // POPULATION - self._literal  # as printed, one more is evaluated
        threshold = setting.accuracy_threshold
        config = SagaConfig(
            population_size=POPULATION,
            num_generations=max(1, generations),
            accuracy_threshold=1.0 if threshold is None else threshold,
            stop_at_threshold=threshold is not None,
            literal=self._literal,
        )
        first = np.unique(setting.starts, axis=0)[:POPULATION]
        return saga.init(setting.num_parameters, setting.seed, first, config)

    def ask(self, state: SagaState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the generation."""
        return saga.ask(state)

    def tell(self, state: SagaState, told: Told) -> tuple[SagaState, RoundInfo]:
        """Return the state with the next generation."""
        state, info = saga.tell(state, told.accuracy, told.is_ok)
        return state, RoundInfo(info.num_failed, info.status, info.best_candidate, info)
