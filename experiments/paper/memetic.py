"""A memetic algorithm, genetic search with simulated annealing of its best, as init / ask / tell.

    state = memetic.init(num_parameters=14, seed=7)
    while state.num_asked < most:
        state = memetic.tell(state, accuracy_of(memetic.ask(state)))

Rounds take turns: a generation is bred and told; its best are annealed for some steps, each a neighbour that is taken
or not (Metropolis); what came of them goes back into the population, which breeds the next generation. The random
numbers of a round depend on the seed and the round alone.

Source: Paz, Molano, Martinez, Gaviria & Arteaga (2015), Transp. Res. C 55, 432-443: a genetic algorithm whose local
    search is simulated annealing, on all parameters at once.
Deviation: written from the article's idea, not from its code, which is not public. Sizes, operators and the cooling
    are stated in `MemeticConfig`; several chains are annealed side by side, so that they fill a batch.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import qmc

from jaxcalib.search.saga.genetic_operators import (
    mutate,
    ranked_weights,
    reflect_into_unit_cube,
    spin_roulette,
    uniform_crossover,
)


@dataclass(frozen=True)
class MemeticConfig:
    """Options.

    Raises:
        ValueError: an option is out of its range.
    """

    population_size: int = 20  # >= 2; the paper's, for its own genetic algorithm
    crossover_probability: float = 0.8  # of a pair
    mutation_probability: float = 0.15  # of an offspring
    num_chains: int = 5  # best candidates of a generation that are annealed
    num_steps: int = 4  # annealing steps between two generations
    temperature: float = 0.5  # at the beginning, as a share of the spread of accuracies in the first generation
    cooling: float = 0.9  # factor of the temperature from step to step
    # standard deviation of a neighbour, as a share of the range, at the first temperature; it shrinks with the
    # square root of the temperature
    step: float = 0.15
    moved_share: float = 0.3  # share of the parameters that a neighbour moves

    def __post_init__(self) -> None:
        """Check the options."""
        if self.population_size < 2 or not 1 <= self.num_chains <= self.population_size or self.num_steps < 1:
            raise ValueError(
                f"Expected a population of at least 2, 1 to that many chains, and at least 1 step; got "
                f"{self.population_size}, {self.num_chains} and {self.num_steps}."
            )
        if not (0.0 < self.cooling <= 1.0 and self.temperature > 0.0 and self.step > 0.0):
            raise ValueError("Expected a cooling in (0, 1], and a temperature and a step above 0.")


@dataclass(frozen=True)
class MemeticState:
    """What the next round needs."""

    config: MemeticConfig  # options
    seed: int  # of all random numbers
    round: int  # number of the round that is asked next
    num_asked: int  # candidates asked for in all rounds told
    population: Float[np.ndarray, "candidate parameter"]  # in the unit cube
    accuracy: Float[np.ndarray, " candidate"]  # of the population; -inf where a candidate failed or has not been told
    asked: Float[np.ndarray, "asked parameter"]  # what is evaluated next
    scale: float  # spread of the accuracies of the first generation
    temperature: float  # of the annealing, as a share of `scale`
    best_candidate: Float[np.ndarray, " parameter"] | None  # best of all that was told; None before
    best_accuracy: float  # its accuracy; -inf before

    @property
    def is_annealing(self) -> bool:
        """Whether the next round is a step of the annealing."""
        return self.round % (1 + self.config.num_steps) != 0


def init(
    num_parameters: int,
    seed: int,
    initial_candidates: Float[np.ndarray, "candidate parameter"] | None = None,
    config: MemeticConfig | None = None,
) -> MemeticState:
    """Begin with the candidates given and a Latin hypercube of further ones.

    Args:
        num_parameters: at least 1.
        seed: >= 0.
        initial_candidates: in the unit cube, at most a population of them.
        config: options; None means `MemeticConfig()`.

    Raises:
        ValueError: the initial candidates are too many or of another length.
    """
    config = MemeticConfig() if config is None else config
    given = np.empty((0, num_parameters)) if initial_candidates is None else initial_candidates
    if given.shape[1] != num_parameters or len(given) > config.population_size:
        raise ValueError(
            f"Expected at most {config.population_size} candidates of {num_parameters} parameters; got {given.shape}."
        )
    rest = qmc.LatinHypercube(num_parameters, rng=_generator(seed, 0)).random(config.population_size - len(given))
    population = np.vstack([given, rest])
    return MemeticState(
        config=config,
        seed=seed,
        round=0,
        num_asked=0,
        population=population,
        accuracy=np.full(len(population), -np.inf),
        asked=population,
        scale=0.0,
        temperature=config.temperature,
        best_candidate=None,
        best_accuracy=-np.inf,
    )


def ask(state: MemeticState) -> Float[np.ndarray, "asked parameter"]:
    """Return what is to be evaluated."""
    return state.asked.copy()


def tell(state: MemeticState, accuracy: Float[np.ndarray, " asked"]) -> MemeticState:
    """Take the accuracies of what was asked and propose the next round.

    Args:
        state: of the last step.
        accuracy: the higher the better; nan or infinite means failed: it never wins, breeds or is annealed.

    Raises:
        ValueError: another number of accuracies than candidates were asked.
    """
    if accuracy.shape != (len(state.asked),):
        raise ValueError(f"Expected the accuracy of {len(state.asked)} candidates; got shape {accuracy.shape}.")
    told = np.where(np.isfinite(accuracy), accuracy, -np.inf)
    rng = _generator(state.seed, state.round + 1)
    state = _with_best(state, told)
    state = _annealed(state, told, rng) if state.is_annealing else _next_generation(state, told)
    state = replace(state, round=state.round + 1, num_asked=state.num_asked + len(told))
    asked = _neighbours(state, rng) if state.is_annealing else _offspring(state, rng)
    return replace(state, asked=asked)


def _with_best(state: MemeticState, told: Float[np.ndarray, " asked"]) -> MemeticState:
    leader = int(np.argmax(told))
    if told[leader] <= state.best_accuracy:
        return state
    return replace(state, best_candidate=state.asked[leader].copy(), best_accuracy=float(told[leader]))


def _next_generation(state: MemeticState, told: Float[np.ndarray, " asked"]) -> MemeticState:
    """Keep the best of parents and offspring, best first."""
    everyone = np.vstack([state.population, state.asked]) if state.round else state.asked
    accuracy = np.concatenate([state.accuracy, told]) if state.round else told
    order = np.argsort(-accuracy, kind="stable")[: state.config.population_size]
    counted = told[np.isfinite(told)]
    scale = state.scale if state.round else float(np.ptp(counted)) if counted.size else 0.0
    return replace(state, population=everyone[order], accuracy=accuracy[order], scale=scale)


def _annealed(state: MemeticState, told: Float[np.ndarray, " asked"], rng: np.random.Generator) -> MemeticState:
    """Take neighbours that are better, and worse ones by Metropolis' probability."""
    chains = np.arange(state.config.num_chains)
    heat = max(state.temperature * state.scale, 1e-12)
    with np.errstate(invalid="ignore", over="ignore"):
        probability = np.exp(np.minimum((told - state.accuracy[chains]) / heat, 0.0))
    is_taken: Bool[np.ndarray, " chain"] = np.isfinite(told) & (rng.random(len(chains)) < np.nan_to_num(probability))
    population, accuracy = state.population.copy(), state.accuracy.copy()
    population[chains[is_taken]], accuracy[chains[is_taken]] = state.asked[is_taken], told[is_taken]
    temperature = state.temperature * state.config.cooling
    return replace(state, population=population, accuracy=accuracy, temperature=temperature)


def _neighbours(state: MemeticState, rng: np.random.Generator) -> Float[np.ndarray, "chain parameter"]:
    config = state.config
    chains = state.population[: config.num_chains]
    is_moved = rng.random(chains.shape) < config.moved_share
    is_moved[np.arange(len(chains)), rng.integers(chains.shape[1], size=len(chains))] = True
    step = config.step * np.sqrt(state.temperature / config.temperature)
    return reflect_into_unit_cube(chains + is_moved * step * rng.standard_normal(chains.shape))


def _offspring(state: MemeticState, rng: np.random.Generator) -> Float[np.ndarray, "candidate parameter"]:
    config, is_told = state.config, np.isfinite(state.accuracy)
    size, num_parameters = state.population.shape
    if not is_told.any():
        return qmc.LatinHypercube(num_parameters, rng=rng).random(size)
    weights = ranked_weights(state.accuracy, is_told)
    parents = state.population[spin_roulette(weights, rng.random(2 * ((size + 1) // 2)))]
    offspring = []
    for mother, father in zip(parents[::2], parents[1::2], strict=True):
        pair = (mother, father)
        if rng.random() < config.crossover_probability:
            pair = uniform_crossover(mother, father, rng)
        offspring += [mutate(child, rng) if rng.random() < config.mutation_probability else child for child in pair]
    return np.stack(offspring)[:size]


def _generator(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=(number,)))
