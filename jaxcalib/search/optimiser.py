"""What every optimiser is told and asked: init, ask, tell, over states that nobody changes in place.

    state = optimiser.init(setting)
    while len(candidates := optimiser.ask(state)):
        state, info = optimiser.tell(state, evaluate(candidates))

`tell` is a function of the state and of what is told, and the random numbers come from the setting's seed. So the same
tells give the same asks, and an optimiser goes on after a stop by being told again what it was told before.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.search.evaluation import SearchStatus

State = Any  # each optimiser's own


@dataclass(frozen=True)
class Told:
    """What became of candidates.

    Attributes:
        points: the candidates, in the unit cube, in the order in which they were asked.
        accuracy: to be maximised; at most 1, any sign; nan if a candidate failed.
        residuals: in units of their noise; nan if a candidate failed. The accuracy falls as their squares rise.
        slopes: of the sum of squared residuals, per unit of each parameter; None where they are not known.
        weight: 1 / noise variance of each candidate's residuals, in units of those that the search asks for; None
            where all are alike.
    """

    points: Float[np.ndarray, "candidate parameter"]
    accuracy: Float[np.ndarray, " candidate"]
    residuals: Float[np.ndarray, "candidate residual"]
    slopes: Float[np.ndarray, "candidate parameter"] | None = None
    weight: Float[np.ndarray, " candidate"] | None = None

    @property
    def is_ok(self) -> Bool[np.ndarray, " candidate"]:
        """Which candidates were evaluated."""
        return np.isfinite(self.accuracy)

    def joined(self, other: "Told | None") -> "Told":
        """Return these candidates after others."""
        if other is None:
            return self
        slopes = weight = None
        if self.slopes is not None and other.slopes is not None:
            slopes = np.vstack([other.slopes, self.slopes])
        if self.weight is not None or other.weight is not None:
            weight = np.concatenate([other.weights, self.weights])
        return Told(
            points=np.vstack([other.points, self.points]),
            accuracy=np.concatenate([other.accuracy, self.accuracy]),
            residuals=np.vstack([other.residuals, self.residuals]),
            slopes=slopes,
            weight=weight,
        )

    @property
    def weights(self) -> Float[np.ndarray, " candidate"]:
        """The weight of each candidate; 1 where all are alike."""
        return np.ones(len(self.points)) if self.weight is None else self.weight


@dataclass(frozen=True)
class Setting:
    """What an optimiser knows before it begins."""

    num_parameters: int  # K >= 1; candidates lie in [0, 1]^K
    num_evaluations: int  # candidates that will be evaluated, for optimisers that plan ahead; nothing more is evaluated
    batch_size: int  # candidates that are evaluated together at no more cost in time than one, >= 2
    start: Float[np.ndarray, " parameter"]  # where to begin, in the unit cube
    has_slopes: bool  # whether evaluations come with exact slopes
    seed: int  # of all random numbers
    # further points that are worth a look, in the unit cube
    more_starts: Float[np.ndarray, "candidate parameter"] | None = None
    # accuracy that ends a search which knows of such an end; None where none does
    accuracy_threshold: float | None = None
    known: Told | None = None  # candidates that were evaluated before; they are not asked again

    @property
    def starts(self) -> Float[np.ndarray, "candidate parameter"]:
        """All points that are worth a look, the start first."""
        return self.start[None] if self.more_starts is None else np.vstack([self.start, self.more_starts])


@dataclass(frozen=True)
class RoundInfo:
    """What a person wants to see of the round just told.

    Attributes:
        num_failed: candidates that failed.
        status: where the search stands. After a final one nothing is to be gained nearby: who asks on gets nothing, or
            a search that begins anew elsewhere.
        best: the optimiser's own answer so far, in the unit cube; None where it is the best candidate seen.
        details: what the optimiser has to say besides.
    """

    num_failed: int
    status: SearchStatus = SearchStatus.RUNNING
    best: Float[np.ndarray, " parameter"] | None = None
    details: Any = None


def info_of(told: Told, status: SearchStatus = SearchStatus.RUNNING) -> RoundInfo:
    """Return what there is to be said of any round."""
    return RoundInfo(int((~told.is_ok).sum()), status)


class Optimiser(ABC):
    """Something that asks for candidates and is told their accuracy.

    Attributes:
        compares_rounds: whether it compares candidates of different rounds. Then they must share their random numbers;
            otherwise each round may have its own, so that nobody wins by luck for long.
    """

    compares_rounds: bool = True

    @abstractmethod
    def init(self, setting: Setting) -> State:
        """Return the first state."""

    @abstractmethod
    def ask(self, state: State) -> Float[np.ndarray, "candidate parameter"]:
        """Return the candidates to evaluate next, in the unit cube; none if the search is over."""

    @abstractmethod
    def tell(self, state: State, told: Told) -> tuple[State, RoundInfo]:
        """Return the state after the candidates asked for have been evaluated; the old one stays as it is."""


def generator(seed: int, *key: int) -> np.random.Generator:
    """Return random numbers that depend on the seed and a key alone."""
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=key))
