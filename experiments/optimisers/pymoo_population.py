"""What pymoo's population searches share: successful candidates only reach the library.

A generation is filled up with new candidates until enough of it has succeeded, so that a failed candidate is neither a
parent nor a difference.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from pymoo.core.algorithm import Algorithm
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.termination import get_termination

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of

MANY = 10**9  # evaluations; the budget ends the search


@dataclass(frozen=True)
class PymooState:
    """Where pymoo stands."""

    setting: Setting  # as given
    algorithm: Algorithm  # pymoo's object, copied before it is changed
    infills: Population  # what it asked for
    # what is to be evaluated next; of the first generation, those that are still missing
    candidates: Float[np.ndarray, "candidate parameter"]
    # successful candidates of the first generation so far, with their accuracies; None once it is complete
    first: tuple[Float[np.ndarray, "candidate parameter"], Float[np.ndarray, " candidate"]] | None
    num_rounds: int = 0  # tells so far


class PymooSearch(Optimiser):
    """A search of pymoo's, behind init, ask and tell."""

    def __init__(self, make: Callable[[Float[np.ndarray, "candidate parameter"]], Algorithm], size: int) -> None:
        """Keep what makes pymoo's algorithm from a first generation."""
        self._make, self._size = make, size

    def init(self, setting: Setting) -> PymooState:
        """Return the first state: the start and random candidates."""
        random = generator(setting.seed, 0).random((self._size - 1, setting.num_parameters))
        candidates = np.vstack([setting.start, random])
        nothing = (candidates[:0], np.zeros(0))
        return PymooState(setting, self._make(candidates), Population(), candidates, nothing)

    def ask(self, state: PymooState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the generation."""
        return state.candidates.copy()

    def tell(self, state: PymooState, told: Told) -> tuple[PymooState, RoundInfo]:
        """Return the state with the next generation."""
        state = replace(state, num_rounds=state.num_rounds + 1)
        if state.first is None:
            algorithm, infills = copy.deepcopy((state.algorithm, state.infills))
            infills.set("F", -told.accuracy[:, None])
            algorithm.tell(infills=infills[told.is_ok])
            return _with_next(state, algorithm), info_of(told)
        points = np.vstack([state.first[0], told.points[told.is_ok]])
        accuracy = np.concatenate([state.first[1], told.accuracy[told.is_ok]])
        num_missing = self._size - len(points)
        if num_missing > 0:
            shape = (num_missing, state.setting.num_parameters)
            candidates = generator(state.setting.seed, state.num_rounds).random(shape)
            return replace(state, candidates=candidates, first=(points, accuracy)), info_of(told)
        algorithm = self._make(points)
        problem = Problem(n_var=state.setting.num_parameters, n_obj=1, xl=0.0, xu=1.0)
        algorithm.setup(problem, seed=state.setting.seed, termination=get_termination("n_eval", MANY))
        infills = algorithm.ask()
        assert infills is not None
        infills.set("F", -accuracy[:, None])
        algorithm.tell(infills=infills)
        return _with_next(replace(state, first=None), algorithm), info_of(told)


def _with_next(state: PymooState, algorithm: Algorithm) -> PymooState:
    infills = algorithm.ask()
    if infills is None:  # the population is one point; there is nothing left to breed
        return replace(state, algorithm=algorithm, candidates=state.candidates[:0])
    candidates = np.clip(np.asarray(infills.get("X"), float), 0.0, 1.0)
    return replace(state, algorithm=algorithm, infills=infills, candidates=candidates)
