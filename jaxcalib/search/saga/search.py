"""Simulation-based adaptive genetic algorithm (SAGA), the paper's Algorithm 3, as init / ask / tell.

    state = saga.init(num_parameters=10, seed=7, initial_candidates=best_rows)
    while not state.status.is_final:
        state, info = saga.tell(state, accuracy_of(saga.ask(state)))

The random numbers of a generation depend on the seed and the generation alone: the state needs no generator, and the
same tells give the same asks bit for bit.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import qmc

from jaxcalib.search.evaluation import SearchStatus, is_successful
from jaxcalib.search.saga.breeding import Brood, breed
from jaxcalib.search.saga.config import SagaConfig


@dataclass(frozen=True)
class SagaState:
    """What the next step needs."""

    config: SagaConfig  # options
    seed: int  # of all random numbers
    generation: int  # number of the generation that is to be evaluated next, from 0
    population: Float[np.ndarray, "candidate parameter"]  # that generation, in the unit cube
    # p_best, best of all evaluated candidates; None if there is none yet
    best_candidate: Float[np.ndarray, " parameter"] | None
    # its accuracy, -inf if there is none. In a literal search the printed f_max, which line 17 of Algorithm 3
    # overwrites, so that it need not belong to the best candidate.
    best_accuracy: float
    status: SearchStatus  # where the search stands


@dataclass(frozen=True)
class SagaInfo:
    """What a person wants to see about the generation just told."""

    generation: int  # its number
    generation_best_accuracy: float  # f_max,cur; -inf if all candidates failed
    generation_mean_accuracy: float  # f_avg,cur over the successful candidates; nan if all failed
    num_failed: int  # candidates that failed
    best_candidate: Float[np.ndarray, " parameter"] | None  # as in the state
    best_accuracy: float  # as in the state
    is_threshold_reached: bool  # whether the best accuracy has reached the threshold
    crossover_probability: Float[np.ndarray, " pair"]  # P_c of each pair that bred; empty if none did
    mutation_probability: Float[np.ndarray, " offspring"]  # P_m of each offspring; empty if none was bred
    status: SearchStatus  # where the search stands


def init(
    num_parameters: int,
    seed: int,
    initial_candidates: Float[np.ndarray, "candidate parameter"] | None = None,
    config: SagaConfig | None = None,
) -> SagaState:
    """Begin a search with the candidates given and a Latin hypercube of further ones.

    Args:
        num_parameters: K >= 1.
        seed: >= 0, of all random numbers.
        initial_candidates: in the unit cube, at most a population of them, for example the best combination of range
            analysis and the best rows of the orthogonal array.
        config: options; None means `SagaConfig()`.

    Raises:
        ValueError: the initial candidates are too many, of another length or outside the unit cube.

    Source: Algorithm 3, line 1.
    Deviation: the paper does not say how the first population comes about.
    """
    config = SagaConfig() if config is None else config
    if num_parameters < 1 or seed < 0:
        raise ValueError(f"Expected num_parameters >= 1 and seed >= 0; got {num_parameters} and {seed}.")
    given = np.empty((0, num_parameters)) if initial_candidates is None else initial_candidates
    if given.ndim != 2 or given.shape[1] != num_parameters or given.shape[0] > config.population_size:
        raise ValueError(
            f"Expected at most {config.population_size} initial candidates of {num_parameters} parameters; got shape "
            f"{given.shape}."
        )
    if not ((given >= 0.0) & (given <= 1.0)).all():
        raise ValueError("Expected initial candidates in the unit cube.")
    rest = _latin_hypercube(config.population_size - given.shape[0], num_parameters, _generator(seed, 0))
    return SagaState(
        config=config,
        seed=seed,
        generation=0,
        population=np.vstack([given, rest]),
        best_candidate=None,
        best_accuracy=-np.inf,
        status=SearchStatus.RUNNING,
    )


def ask(state: SagaState) -> Float[np.ndarray, "candidate parameter"]:
    """Return the generation that is to be evaluated; no candidates if the search is over."""
    return state.population[:0].copy() if state.status.is_final else state.population.copy()


def tell(
    state: SagaState, accuracy: Float[np.ndarray, " candidate"], is_ok: Bool[np.ndarray, " candidate"] | None = None
) -> tuple[SagaState, SagaInfo]:
    """Take the accuracy of the generation asked for and breed the next one.

    Args:
        state: of the last step.
        accuracy: of each candidate, at most 1, any sign; nan or infinite means failed.
        is_ok: what the simulator said about each candidate; None means that all went well.

    Raises:
        ValueError: another number of accuracies than candidates were asked, or shapes that differ.

    Source: Algorithm 3, lines 2-32; Eq. 20.
    Deviation: exactly G_max generations are evaluated, and the last one is not bred from (`iter <= G_max` from 0
        evaluates one more and breeds once too often). The threshold counts as reached at equality, as in Algorithm 1.
        Failed candidates never win, breed or enter a mean; if all fail, the next generation is drawn anew, with the
        best candidate so far if there is one. With `literal` the counting, the strict threshold and the overwritten
        f_max are as printed.
    """
    config = state.config
    num_asked = ask(state).shape[0]
    if accuracy.shape != (num_asked,):
        raise ValueError(f"Expected the accuracy of {num_asked} candidates; got shape {accuracy.shape}.")
    is_counted = is_successful(accuracy, is_ok)
    counted = np.where(is_counted, accuracy, -np.inf)
    leader = int(np.argmax(counted))
    generation_best = float(counted[leader])
    best_candidate, best_accuracy = state.best_candidate, state.best_accuracy
    if generation_best > best_accuracy:
        best_candidate, best_accuracy = state.population[leader].copy(), generation_best
    is_threshold_reached = (
        best_accuracy > config.accuracy_threshold if config.literal else best_accuracy >= config.accuracy_threshold
    )

    next_generation = state.generation + 1
    is_last = next_generation == config.num_generations + (1 if config.literal else 0)
    status, population, brood = SearchStatus.RUNNING, state.population, None
    if is_threshold_reached and config.stop_at_threshold:
        status = SearchStatus.THRESHOLD_REACHED
    elif is_last and not config.literal:
        status = SearchStatus.COMPLETE if best_candidate is not None else SearchStatus.NOTHING_SUCCEEDED
    elif not is_counted.any():
        rng = _generator(state.seed, next_generation)
        status, population = SearchStatus.RESAMPLED, _resample(state, best_candidate, rng)
    else:
        brood = breed(state.population, accuracy, is_counted, config, _generator(state.seed, next_generation))
        if brood is None:
            status = SearchStatus.SELECTION_UNDEFINED
        else:
            population = brood.population
            if config.literal:
                best_accuracy = brood.last_pair_accuracy
    if is_last and config.literal and not status.is_final:
        status = SearchStatus.COMPLETE if best_candidate is not None else SearchStatus.NOTHING_SUCCEEDED

    new_state = replace(
        state,
        generation=next_generation,
        population=population,
        best_candidate=best_candidate,
        best_accuracy=best_accuracy,
        status=status,
    )
    return new_state, _info(new_state, accuracy, is_counted, is_threshold_reached, brood)


def _info(
    state: SagaState,
    accuracy: Float[np.ndarray, " candidate"],
    is_counted: Bool[np.ndarray, " candidate"],
    is_threshold_reached: bool,
    brood: Brood | None,
) -> SagaInfo:
    counted = accuracy[is_counted]
    return SagaInfo(
        generation=state.generation - 1,
        generation_best_accuracy=float(counted.max(initial=-np.inf)),
        generation_mean_accuracy=float(counted.mean()) if counted.size else np.nan,
        num_failed=int((~is_counted).sum()),
        best_candidate=state.best_candidate,
        best_accuracy=state.best_accuracy,
        is_threshold_reached=is_threshold_reached,
        crossover_probability=np.empty(0) if brood is None else brood.crossover_probability,
        mutation_probability=np.empty(0) if brood is None else brood.mutation_probability,
        status=state.status,
    )


def _generator(seed: int, generation: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=(generation,)))


def _latin_hypercube(
    num_candidates: int, num_parameters: int, rng: np.random.Generator
) -> Float[np.ndarray, "candidate parameter"]:
    if num_candidates == 0:
        return np.empty((0, num_parameters))
    return qmc.LatinHypercube(num_parameters, rng=rng).random(num_candidates)


def _resample(
    state: SagaState, best_candidate: Float[np.ndarray, " parameter"] | None, rng: np.random.Generator
) -> Float[np.ndarray, "candidate parameter"]:
    """Return a fresh population, with the best candidate so far where elites survive."""
    num_candidates, num_parameters = state.population.shape
    population = _latin_hypercube(num_candidates, num_parameters, rng)
    if best_candidate is not None and state.config.num_elites > 0 and not state.config.literal:
        population[0] = best_candidate
    return population
