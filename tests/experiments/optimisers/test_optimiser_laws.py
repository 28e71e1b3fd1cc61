"""Laws that hold for every optimiser of the registry, and for one that a test adds to it."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from jaxtyping import Float

from experiments.optimisers.known_functions import FunctionProblem
from experiments.optimisers.registry import OPTIMISERS
from jaxcalib.search import registry
from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, info_of

NUM_PARAMETERS, NUM_EVALUATIONS = 3, 100
UNINFORMED = ("random", "sobol")
DETERMINISTIC = ("trust_region", "gradient_descent")  # from one start, until they begin anew
# Crosses over only and has no elite, so that 100 evaluations may end where the first generation was.
NO_BETTER_THAN_RANDOM = (*UNINFORMED, "saga_literal")


def setting_of(problem: FunctionProblem, has_slopes: bool = False) -> Setting:
    return Setting(NUM_PARAMETERS, NUM_EVALUATIONS, 8, problem.start, has_slopes, problem.seed)


def course(optimiser: Optimiser, problem: FunctionProblem, has_slopes: bool = False) -> list[Told]:
    """Return the rounds of a whole search."""
    state = optimiser.init(setting_of(problem, has_slopes))
    rounds: list[Told] = []
    num_evaluated = 0
    while num_evaluated < NUM_EVALUATIONS:
        points = optimiser.ask(state)
        assert points.shape[1] == NUM_PARAMETERS
        assert ((points >= 0.0) & (points <= 1.0)).all()
        if not len(points):
            break
        rounds.append(problem.evaluate(points, num_evaluated))
        num_evaluated += len(points)
        if num_evaluated < NUM_EVALUATIONS:
            state, _ = optimiser.tell(state, rounds[-1])
    return rounds


def best_error(problem: FunctionProblem, rounds: list[Told]) -> float:
    points = np.vstack([one.points for one in rounds])
    accuracy = np.concatenate([one.accuracy for one in rounds])
    return float(problem.measure(points[[np.nanargmax(accuracy)]])["error"][0])


@pytest.mark.parametrize("name", OPTIMISERS)
def test_the_same_seed_gives_the_same_and_what_was_told_decides_the_next_ask(name: str):
    problem = FunctionProblem("rosenbrock", "failing", NUM_PARAMETERS, 3)
    rounds = course(OPTIMISERS[name](), problem)
    replayed = OPTIMISERS[name]()
    state = replayed.init(setting_of(problem))
    for one in rounds[:-1]:
        np.testing.assert_array_equal(replayed.ask(state), one.points)
        before, (state, _) = state, replayed.tell(state, one)
        np.testing.assert_array_equal(replayed.ask(before), one.points)  # the old state is as it was
    np.testing.assert_array_equal(replayed.ask(state), rounds[-1].points)


@pytest.mark.parametrize("name", OPTIMISERS)
def test_another_seed_gives_other_candidates(name: str):
    problem = FunctionProblem("sphere", "exact", NUM_PARAMETERS, 3)
    candidates = []
    for seed in (0, 1):
        optimiser = OPTIMISERS[name]()
        state = optimiser.init(Setting(NUM_PARAMETERS, NUM_EVALUATIONS, 8, problem.start, False, seed))
        told = []
        for _ in range(6):
            points = optimiser.ask(state)
            told.append(points)
            if not len(points):
                break
            state, _ = optimiser.tell(state, problem.evaluate(points, 0))
        candidates.append(np.vstack(told))
    if name not in DETERMINISTIC:
        shared = min(map(len, candidates))
        assert not np.array_equal(candidates[0][:shared], candidates[1][:shared])


@pytest.mark.parametrize("name", [name for name in OPTIMISERS if name not in NO_BETTER_THAN_RANDOM])
def test_beats_random_search_on_the_sphere(name: str):
    problems = [FunctionProblem("sphere", "exact", NUM_PARAMETERS, seed) for seed in range(5)]
    ours = [best_error(problem, course(OPTIMISERS[name](), problem)) for problem in problems]
    random = [best_error(problem, course(OPTIMISERS["random"](), problem)) for problem in problems]
    assert np.median(ours) < np.median(random)


@pytest.mark.parametrize("name", [name for name in OPTIMISERS if name not in UNINFORMED])
def test_values_of_failed_candidates_are_not_looked_at(name: str):
    """Failed candidates carry nan only; were they averaged, bred from or moved to, nan would come out."""
    problem = FunctionProblem("sphere", "failing", NUM_PARAMETERS, 5)
    rounds = course(OPTIMISERS[name](), problem)
    failed = np.concatenate([~one.is_ok for one in rounds])
    assert failed.any()
    half = len(failed) // 2
    if name != "saga_literal":  # the later half keeps away from where candidates fail
        assert failed[half:].mean() <= failed[:half].mean() + 0.25


@pytest.mark.parametrize("name", OPTIMISERS)
def test_goes_on_when_everything_fails(name: str):
    class AlwaysFails(FunctionProblem):
        def evaluate(self, points: np.ndarray, first: int) -> Told:
            told = super().evaluate(points, first)
            return Told(points, np.full(len(points), np.nan), np.full_like(told.residuals, np.nan))

    rounds = course(OPTIMISERS[name](), AlwaysFails("sphere", "exact", NUM_PARAMETERS, 7))
    assert len(rounds) > 1
    assert len(np.unique(np.vstack([one.points for one in rounds]), axis=0)) > NUM_EVALUATIONS // 3


def test_exact_slopes_beat_differences():
    problems = [FunctionProblem("rosenbrock", "exact", NUM_PARAMETERS, seed) for seed in range(5)]
    errors = [
        [best_error(problem, course(OPTIMISERS["gradient_descent"](), problem, exact)) for problem in problems]
        for exact in (True, False)
    ]
    assert np.median(errors[0]) < np.median(errors[1])


@pytest.mark.parametrize("name", registry.OPTIMISERS)
def test_what_is_said_of_a_round_counts_its_failures(name: str):
    problem = FunctionProblem("sphere", "failing", NUM_PARAMETERS, 5)
    optimiser = registry.OPTIMISERS[name]()
    state = optimiser.init(setting_of(problem))
    told = problem.evaluate(optimiser.ask(state), 0)
    _, info = optimiser.tell(state, told)
    assert info.num_failed == (~told.is_ok).sum()
    assert isinstance(info.status, SearchStatus)


def test_a_trust_region_that_has_converged_says_so_and_begins_anew_elsewhere():
    problem = FunctionProblem("sphere", "exact", NUM_PARAMETERS, 2)
    optimiser = registry.OPTIMISERS["trust_region"]()
    state = optimiser.init(setting_of(problem))
    info = RoundInfo(0)
    while not info.status.is_final:
        state, info = optimiser.tell(state, problem.evaluate(optimiser.ask(state), 0))
    assert info.status is SearchStatus.CONVERGED
    np.testing.assert_allclose(info.details.center, problem.optimum, atol=1e-3)
    assert np.abs(optimiser.ask(state)[0] - info.details.center).max() > 0.05


def test_a_trust_region_names_no_centre_that_failed_or_was_never_evaluated():
    problem = FunctionProblem("sphere", "exact", NUM_PARAMETERS, 2)
    optimiser = registry.OPTIMISERS["trust_region"]()
    state = optimiser.init(setting_of(problem))
    told = problem.evaluate(optimiser.ask(state), 0)
    nothing = replace(
        told, accuracy=np.full_like(told.accuracy, np.nan), residuals=np.full_like(told.residuals, np.nan)
    )
    state, info = optimiser.tell(state, nothing)
    assert info.best is None
    state, info = optimiser.tell(state, problem.evaluate(optimiser.ask(state), 0))
    assert info.best is not None
    np.testing.assert_array_equal(info.best, info.details.center)


@pytest.mark.parametrize("name", registry.OPTIMISERS)
def test_what_is_known_before_is_no_harm(name: str):
    """Candidates that were evaluated before the search may help; the search asks within the cube all the same."""
    problem = FunctionProblem("rosenbrock", "exact", NUM_PARAMETERS, 3)
    points = np.random.default_rng(5).random((30, NUM_PARAMETERS))
    known = problem.evaluate(points, 0)
    optimiser = registry.OPTIMISERS[name]()
    setting = replace(setting_of(problem), known=known, more_starts=points[:2])
    state = optimiser.init(setting)
    for _ in range(3):
        asked = optimiser.ask(state)
        assert ((asked >= 0.0) & (asked <= 1.0)).all()
        if not len(asked):
            break  # as printed, Algorithm 3 ends where an accuracy is negative
        state, _ = optimiser.tell(state, problem.evaluate(asked, 0))


@dataclass(frozen=True)
class Shrinking:
    """Where the search of `ShrinkingBox` stands."""

    setting: Setting
    best: Float[np.ndarray, " parameter"]
    accuracy: float = -np.inf
    number: int = 0


class ShrinkingBox(Optimiser):
    """Draws around the best candidate so far, closer each time: all that a new optimiser's file holds."""

    def init(self, setting: Setting) -> Shrinking:
        """Return the first state."""
        return Shrinking(setting, setting.start)

    def ask(self, state: Shrinking) -> Float[np.ndarray, "candidate parameter"]:
        """Return draws around the best."""
        setting = state.setting
        width = max(0.8**state.number, 0.05)
        rng = np.random.default_rng([setting.seed, state.number])
        shape = (setting.batch_size, setting.num_parameters)
        return np.clip(state.best + width * rng.uniform(-0.5, 0.5, shape), 0.0, 1.0)

    def tell(self, state: Shrinking, told: Told) -> tuple[Shrinking, RoundInfo]:
        """Return the state around the best of what was told."""
        state = replace(state, number=state.number + 1)
        accuracy = np.where(told.is_ok, told.accuracy, -np.inf)
        if accuracy.max() > state.accuracy:
            best = int(np.argmax(accuracy))
            state = replace(state, best=told.points[best], accuracy=float(accuracy[best]))
        return state, info_of(told)


def test_a_new_optimiser_is_a_file_and_a_line_in_the_registry(monkeypatch: pytest.MonkeyPatch):
    """All laws hold for it as they stand; what a calibration makes of it is in `test_parts_left_out`."""
    monkeypatch.setitem(OPTIMISERS, "shrinking_box", ShrinkingBox)
    monkeypatch.setitem(registry.OPTIMISERS, "shrinking_box", ShrinkingBox)
    for law in (
        test_the_same_seed_gives_the_same_and_what_was_told_decides_the_next_ask,
        test_another_seed_gives_other_candidates,
        test_beats_random_search_on_the_sphere,
        test_values_of_failed_candidates_are_not_looked_at,
        test_goes_on_when_everything_fails,
        test_what_is_said_of_a_round_counts_its_failures,
        test_what_is_known_before_is_no_harm,
    ):
        law("shrinking_box")
