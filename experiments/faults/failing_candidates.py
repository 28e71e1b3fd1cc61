"""Searches whose objective fails for some candidates: what an optimiser calls the best has been evaluated, and well.

Candidates fail by chance, or where they lie: in a slab that is a share of the cube, right beside the optimum. A trial
makes several searches, and further ones until candidates have failed in them; without any it does not count.
"""

import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from experiments.faults.attack import Attack, Ending, Ground, Trial, in_one_line
from experiments.optimisers.known_functions import FunctionProblem
from experiments.optimisers.registry import OPTIMISERS
from jaxcalib.search import soat
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told
from jaxcalib.search.orthogonal_arrays.orthogonal_array import orthogonal_array

NUM_PARAMETERS, NUM_EVALUATIONS, BATCH_SIZE = 4, 80, 8
NUM_LEVELS = 5  # of the array whose cases SOAT tests
NUM_SEARCHES, MOST_SEARCHES = 3, 12  # of a trial; and where no candidate has failed in them
SHARES = (0.01, 0.05, 0.2, 0.5)
BY_CHANCE, BY_PLACE = "by chance", "by place"
BESIDE = 0.01  # from the optimum to the slab

Points = Float[np.ndarray, "candidate parameter"]


class Soat(Optimiser):
    """SOAT, as optimisers are asked and told."""

    def init(self, setting: Setting) -> soat.SoatState:
        """Begin the test of an array."""
        array = orthogonal_array(setting.num_parameters, NUM_LEVELS)
        zeros = np.zeros(setting.num_parameters)
        return soat.init(array, zeros, zeros + 1.0, setting.start)

    def ask(self, state: soat.SoatState) -> Points:
        """Return some of its cases."""
        return soat.ask(state)[:BATCH_SIZE]

    def tell(self, state: soat.SoatState, told: Told) -> tuple[soat.SoatState, RoundInfo]:
        """Take what became of them."""
        before = soat.summarise(state)
        state, info = soat.tell(state, told.accuracy)
        return state, RoundInfo(info.num_failed - before.num_failed, info.status, info.best_candidate)


SEARCHES: Mapping[str, Callable[[], Optimiser]] = {**OPTIMISERS, "soat": Soat}


class FailingProblem:
    """A function of known optimum that fails for a share of all candidates."""

    def __init__(self, share: float, how: str, seed: int, chance: np.random.Generator) -> None:
        """Draw who fails.

        Args:
            share: of the candidates.
            how: by chance or by place.
            seed: of the function.
            chance: decides who fails by chance.
        """
        self.function = FunctionProblem("rosenbrock", "exact", NUM_PARAMETERS, seed)
        self._share, self._how, self._chance = share, how, chance
        self.told: list[Told] = []

    @property
    def start(self) -> Float[np.ndarray, " parameter"]:
        """Where searches begin, below the slab."""
        return self.function.start

    def fails_at(self, points: Points) -> Bool[np.ndarray, " candidate"]:
        """Return who fails where they lie, whatever chance says."""
        if self._how == BY_CHANCE:
            return np.zeros(len(points), bool)
        first = self.function.optimum[0]
        begin = min(first + BESIDE, 1.0 - self._share)
        return (points[:, 0] > begin) & (points[:, 0] < begin + self._share)

    def evaluate(self, points: Points) -> Told:
        """Return what becomes of candidates; the start, which is the first, does not fail."""
        first = sum(len(told.points) for told in self.told)
        good = self.function.evaluate(points, first)
        has_failed = self.fails_at(points)
        if self._how == BY_CHANCE:
            has_failed = self._chance.random(len(points)) < self._share
        has_failed &= np.arange(first, first + len(points)) > 0
        assert good.slopes is not None
        told = Told(
            points,
            np.where(has_failed, np.nan, good.accuracy),
            np.where(has_failed[:, None], np.nan, good.residuals),
            np.where(has_failed[:, None], np.nan, good.slopes),
        )
        self.told.append(told)
        return told


def complaint_of(problem: FailingProblem, told: Told, info: RoundInfo) -> str:
    """Return what is wrong with an optimiser's word after a round; nothing where all is well."""
    if not np.array_equal(info.num_failed, (~told.is_ok).sum()):
        return f"counts {info.num_failed} failures of {(~told.is_ok).sum()}"
    if info.best is None:
        return ""
    if info.best.shape != (NUM_PARAMETERS,) or not np.isfinite(info.best).all():
        return f"its best is no point: {info.best}"
    if (info.best < 0.0).any() or (info.best > 1.0).any():
        return f"its best is outside of the cube: {info.best}"
    points = np.vstack([one.points for one in problem.told])
    is_ok = np.concatenate([one.is_ok for one in problem.told])
    same = (points == info.best).all(axis=1)
    if same.any():  # the start succeeds even where it lies within the slab
        return "" if is_ok[same].any() else "its best is a candidate that failed"
    return f"its best fails: {info.best}" if problem.fails_at(info.best[None])[0] else ""


@dataclass(frozen=True)
class Searched:
    """How a search went."""

    wrong: str  # what is wrong with it; nothing where all is well
    num_evaluated: int
    num_failed: int
    best: float  # accuracy


def search(make: Callable[[], Optimiser], problem: FailingProblem, seed: int) -> Searched:
    """Make a whole search, and look at every word of the optimiser."""
    optimiser = make()
    setting = Setting(NUM_PARAMETERS, NUM_EVALUATIONS, BATCH_SIZE, problem.start, False, seed)
    state = optimiser.init(setting)
    num_evaluated = num_failed = 0
    best, wrong = -np.inf, ""
    while num_evaluated < NUM_EVALUATIONS and not wrong:
        asked = optimiser.ask(state)
        if not len(asked):
            break
        points = asked[: NUM_EVALUATIONS - num_evaluated]
        if not np.isfinite(points).all() or (points < 0.0).any() or (points > 1.0).any():
            wrong = f"asks for what is no point of the cube: {points}"
            break
        told = problem.evaluate(points)
        num_evaluated, num_failed = num_evaluated + len(points), num_failed + int((~told.is_ok).sum())
        best = max(best, float(np.max(told.accuracy, where=told.is_ok, initial=-np.inf)))
        if len(points) < len(asked):
            break  # a round that was cut short is not told
        state, info = optimiser.tell(state, told)
        if words := complaint_of(problem, told, info):
            wrong = f"after {num_evaluated} candidates: {words}"
    if not wrong and num_evaluated < 2 * BATCH_SIZE:
        wrong = f"gives up after {num_evaluated} candidates"
    return Searched(wrong, num_evaluated, num_failed, best)


def trials(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Make the searches of these numbers: each optimiser, each share, by chance and by place."""
    for number in numbers:
        name, share, how = PLANS[number]
        began_s = time.perf_counter()
        ending, happened = try_optimiser(SEARCHES[name], share, how, ground.chance(number))
        wall_s = time.perf_counter() - began_s
        yield Trial(number, f"{name}, {share:.0%} fail {how}", ending, in_one_line(happened), wall_s)


def try_optimiser(
    make: Callable[[], Optimiser], share: float, how: str, chance: np.random.Generator
) -> tuple[Ending, str]:
    """Let an optimiser search several times; return how it bore that, and what happened."""
    num_evaluated = num_failed = num_searches = 0
    while num_searches < NUM_SEARCHES or (num_searches < MOST_SEARCHES and not num_failed):
        seed = int(chance.integers(1 << 16))
        with warnings.catch_warnings(), redirect_stdout(None):
            warnings.simplefilter("ignore")  # libraries have much to say, of optimisers that the program does not use
            try:
                searched = search(make, FailingProblem(share, how, seed, chance), seed)
            except Exception as error:
                return "failed", f"seed {seed}: {type(error).__name__}: {error}"
        if searched.wrong:
            return "failed", f"seed {seed}: {searched.wrong}"
        num_searches += 1
        num_evaluated, num_failed = num_evaluated + searched.num_evaluated, num_failed + searched.num_failed
    words = f"{num_failed} of {num_evaluated} candidates failed in {num_searches} searches"
    return ("passed" if num_failed else "not run"), words


# the levels of SOAT's array leave out so thin a slab
PLANS = [plan for plan in product(SEARCHES, SHARES, (BY_CHANCE, BY_PLACE)) if plan != ("soat", 0.01, BY_PLACE)]
ATTACK = Attack(
    asks="1, 5, 20 and 50 % of candidates fail, for every optimiser: its best is always a valid one",
    usual=len(PLANS),
    most=len(PLANS),
    trials=trials,
)
