"""Covariance matrix adaptation: the package `cmaes`, whose generations are filled up until enough have succeeded."""

import copy
from dataclasses import dataclass, replace

import numpy as np
from cmaes import CMA
from jaxtyping import Float

from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of

INITIAL_SIGMA = 0.25  # of the unit range


@dataclass(frozen=True)
class CmaState:
    """Where CMA-ES stands."""

    setting: Setting  # as given
    strategy: CMA  # the package's object, copied before it is changed
    candidates: Float[np.ndarray, "candidate parameter"]  # what is to be evaluated next
    # successful candidates of this generation so far, with their losses
    kept: tuple[tuple[Float[np.ndarray, " parameter"], float], ...] = ()
    num_restarts: int = 0  # how often the search began anew because it had converged
    num_tells: int = 0  # tells so far


class CmaEs(Optimiser):
    """CMA-ES in the unit cube; begins anew at a random mean when it has converged."""

    def init(self, setting: Setting) -> CmaState:
        """Return the first state: a generation around the start."""
        return _begin(setting, setting.start, 0, 0)

    def ask(self, state: CmaState) -> Float[np.ndarray, "candidate parameter"]:
        """Return what the generation still needs."""
        return state.candidates.copy()

    def tell(self, state: CmaState, told: Told) -> tuple[CmaState, RoundInfo]:
        """Return the state with the next generation, or with more candidates for this one."""
        successes = zip(told.points[told.is_ok], -told.accuracy[told.is_ok], strict=True)
        kept = (*state.kept, *((point, float(loss)) for point, loss in successes))
        strategy, number = copy.deepcopy(state.strategy), state.num_tells + 1
        strategy.reseed_rng(_seed(state.setting, number))  # a copy has random numbers of its own otherwise
        size = strategy.population_size
        if len(kept) >= size:
            strategy.tell(list(kept[:size]))
            kept = ()
            if strategy.should_stop():
                mean = generator(state.setting.seed, number).random(state.setting.num_parameters)
                state = _begin(state.setting, mean, state.num_restarts + 1, number)
                return state, info_of(told, SearchStatus.CONVERGED)
        candidates = _draw(strategy, size - len(kept))
        state = replace(state, strategy=strategy, candidates=candidates, kept=kept, num_tells=number)
        return state, info_of(told)


def _begin(setting: Setting, mean: Float[np.ndarray, " parameter"], num_restarts: int, num_tells: int) -> CmaState:
    bounds = np.tile([0.0, 1.0], (setting.num_parameters, 1))
    strategy = CMA(mean, INITIAL_SIGMA, bounds, seed=_seed(setting, num_tells))
    candidates = _draw(strategy, strategy.population_size)
    return CmaState(setting, strategy, candidates, num_restarts=num_restarts, num_tells=num_tells)


def _seed(setting: Setting, number: int) -> int:
    return int(np.random.SeedSequence([setting.seed, number]).generate_state(1)[0])


def _draw(strategy: CMA, count: int) -> Float[np.ndarray, "candidate parameter"]:
    return np.stack([strategy.ask() for _ in range(count)])
