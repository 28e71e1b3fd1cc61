from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float

from jaxcalib.search import GaussianPrior, SearchStatus, TrustRegionConfig, TrustRegionState, trust_region
from jaxcalib.search.trust_region.evaluated_points import EvaluatedPoints, compare_points

RNG = np.random.default_rng(1)
JACOBIAN = 3.0 * RNG.normal(size=(6, 4))
TRUTH = np.array([0.62, 0.31, 0.77, 0.15])
NOISE = np.array([0.05, 0.1, 0.2, 0.1, 0.05, 0.3])
START = np.array([0.2, 0.8, 0.3, 0.6])
PRECISION = (JACOBIAN / NOISE[:, None]).T @ (JACOBIAN / NOISE[:, None])
EXACT = 1e8  # weight of residuals without noise


def linear(points: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, "candidate measure"]:
    return (points - TRUTH) @ JACOBIAN.T


def rosenbrock(points: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, "candidate measure"]:
    """Rosenbrock's residuals on [-1.5, 2]^2; both are 0 at 5/7."""
    x = -1.5 + 3.5 * points
    return np.stack([10.0 * (x[:, 1] - x[:, 0] ** 2), 1.0 - x[:, 0]], axis=1)


def run(
    state: TrustRegionState,
    residuals_of: Callable[[np.ndarray], np.ndarray],
    weights: Float[np.ndarray, " measure"],
    prior: GaussianPrior | None = None,
) -> TrustRegionState:
    while not state.status.is_final:
        candidates = trust_region.ask(state)
        assert ((candidates >= 0.0) & (candidates <= 1.0)).all()
        state, _ = trust_region.tell(state, residuals_of(candidates), weights, prior=prior)
    return state


@pytest.mark.parametrize("design", ["central", "two_level"])
def test_it_converges_on_a_noisy_quadratic(design: str) -> None:
    # 20 noise seeds. Squared distance in units of the posterior covariance of a single run: if a single run at each
    # point were all there is, it would be chi-square with 4 degrees of freedom (mean 4); averaging makes it less.
    config = TrustRegionConfig(design="central" if design == "central" else "two_level")
    distances = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        state = run(
            trust_region.init(START, config),
            lambda points, rng=rng: linear(points) + rng.normal(size=(len(points), 6)) * NOISE,
            1.0 / NOISE**2,
        )
        assert state.status is SearchStatus.CONVERGED
        distances.append(float((state.center - TRUTH) @ PRECISION @ (state.center - TRUTH)))
    assert np.mean(distances) < 4.0
    assert max(distances) < 23.5  # 99.99 % quantile of chi-square with 4 degrees of freedom


@pytest.mark.parametrize("surface", ["linear", "quadratic"])
@pytest.mark.parametrize("design", ["central", "two_level"])
def test_it_converges_on_rosenbrocks_residuals(surface: str, design: str) -> None:
    config = TrustRegionConfig(
        num_iterations=60,
        least_radius=1e-4,
        surface="linear" if surface == "linear" else "quadratic",
        design="central" if design == "central" else "two_level",
    )
    state = run(trust_region.init(np.array([0.1, 0.75]), config), rosenbrock, np.full(2, EXACT))
    np.testing.assert_allclose(state.center, [5 / 7, 5 / 7], atol=1e-3)


def test_a_prior_pulls_the_result_to_the_posterior_mode() -> None:
    prior = GaussianPrior(np.array([0.5, 0.5, 0.6, 0.3]), np.diag([2.0, 0.5, 1.0, 4.0]) * PRECISION.max())
    state = run(trust_region.init(START), linear, 1.0 / NOISE**2, prior)
    mode = np.linalg.solve(PRECISION + prior.precision, PRECISION @ TRUTH + prior.precision @ prior.mean)
    assert np.abs(mode - TRUTH).max() > 0.05
    # The search ends when a step would gain less than 0.1, that is within sqrt(0.1) posterior standard deviations.
    offset = state.center - mode
    assert offset @ (PRECISION + prior.precision) @ offset < 0.2


def test_a_parameter_without_effect_goes_to_its_prior_mean_and_stays_without_one() -> None:
    dead = JACOBIAN.copy()
    dead[:, 2] = 0.0
    prior = GaussianPrior(np.full(4, 0.7), np.diag([0.0, 0.0, 400.0, 0.0]))
    with_prior, without = (
        run(trust_region.init(START), lambda points: (points - TRUTH) @ dead.T, 1.0 / NOISE**2, given_prior)
        for given_prior in (prior, None)
    )
    assert abs(with_prior.center[2] - 0.7) < 0.02
    # The ridge leaves up to 1e-4 of the other slopes unexplained, which reused points may ascribe to this parameter.
    np.testing.assert_allclose(without.center[2], START[2], atol=1e-3)


def test_the_optimum_outside_the_cube_ends_at_its_border() -> None:
    def outside(points: np.ndarray) -> np.ndarray:
        return np.stack([points[:, 0] + 0.3, 2.0 * (points[:, 1] - 0.4), points[:, 2] - 1.4], axis=1)

    state = run(trust_region.init(np.array([0.5, 0.9, 0.7])), outside, np.full(3, EXACT))
    np.testing.assert_allclose(state.center, [0.0, 0.4, 1.0], atol=1e-3)


@given(st.integers(0, 10**6), st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4), st.data())
@settings(max_examples=60, deadline=None)
def test_asks_stay_in_the_unit_cube_whatever_is_told(seed: int, center: list[float], data: st.DataObject) -> None:
    config = TrustRegionConfig(
        num_iterations=4,
        design=data.draw(st.sampled_from(["central", "two_level"])),
        surface=data.draw(st.sampled_from(["linear", "quadratic"])),
        step_fractions=(1.0, 0.4),
    )
    rng = np.random.default_rng(seed)
    state = trust_region.init(np.array(center), config)
    while not state.status.is_final:
        candidates = trust_region.ask(state)
        assert candidates.shape[0] >= 2
        assert ((candidates >= 0.0) & (candidates <= 1.0)).all()
        residuals = rng.standard_cauchy((len(candidates), 3))
        residuals[rng.random(len(candidates)) < 0.2] = np.nan
        state, _ = trust_region.tell(state, residuals, rng.uniform(0.0, 4.0, size=residuals.shape))
    assert state.iteration <= 4


def test_the_same_tells_give_the_same_asks_bit_for_bit() -> None:
    asks = []
    for _ in range(2):
        rng = np.random.default_rng(7)
        state = trust_region.init(START, TrustRegionConfig(num_iterations=5, least_predicted_improvement=0.0))
        while not state.status.is_final:
            asks.append(trust_region.ask(state))
            noise = rng.normal(size=(len(asks[-1]), 6)) * NOISE
            state, _ = trust_region.tell(state, linear(asks[-1]) + noise, 1.0 / NOISE**2)
    assert len(asks) == 20
    assert all((first == second).all() for first, second in zip(asks[:10], asks[10:], strict=True))


def test_failed_candidates_are_dropped() -> None:
    def failing(points: np.ndarray) -> np.ndarray:
        residuals = linear(points)
        residuals[2::5, 3] = np.nan  # one undefined measure is a failure
        return residuals

    state = run(trust_region.init(START), failing, 1.0 / NOISE**2)
    assert (state.center - TRUTH) @ PRECISION @ (state.center - TRUTH) < 0.2
    assert state.evaluated is not None
    assert np.isfinite(state.evaluated.residuals).all()


def test_flagged_candidates_never_become_the_centre() -> None:
    state = trust_region.init(START)
    state, _ = trust_region.tell(state, linear(trust_region.ask(state)), 1.0 / NOISE**2)
    trial = trust_region.ask(state)
    state, info = trust_region.tell(state, 0.0 * linear(trial), 1.0 / NOISE**2, is_ok=np.zeros(len(trial), dtype=bool))
    assert info.is_trial
    assert not info.is_accepted
    assert (state.center == START).all()
    assert state.radius == 0.5 * state.config.initial_radius


def test_if_the_centre_fails_the_best_other_point_takes_its_place() -> None:
    state = trust_region.init(START)
    design = trust_region.ask(state)
    residuals = linear(design)
    residuals[0] = np.nan
    state, info = trust_region.tell(state, residuals, 1.0 / NOISE**2)
    misfit = (residuals**2 / NOISE**2).sum(axis=1)
    assert (info.center == design[np.nanargmin(misfit)]).all()
    np.testing.assert_allclose(info.center_misfit, np.nanmin(misfit), rtol=1e-12)


def test_if_all_candidates_fail_the_region_shrinks_and_the_status_says_so() -> None:
    state = trust_region.init(START)
    state, info = trust_region.tell(state, np.full((9, 6), np.nan), np.ones(6))
    assert info.status is SearchStatus.RESAMPLED
    assert info.num_failed == 9
    assert np.isnan(info.center_misfit)
    assert trust_region.ask(state).shape == (9, 4)
    assert state.radius == 0.5 * state.config.initial_radius
    state = run(state, lambda points: np.full((len(points), 6), np.nan), np.ones(6))
    assert state.status is SearchStatus.NOTHING_SUCCEEDED


def test_a_measure_of_weight_zero_is_left_out_even_if_undefined() -> None:
    def undefined(points: np.ndarray) -> np.ndarray:
        return np.hstack([linear(points), np.full((len(points), 1), np.nan)])

    weights = 1.0 / NOISE**2
    with_measure = run(trust_region.init(START), undefined, np.append(weights, 0.0))
    without = run(trust_region.init(START), linear, weights)
    np.testing.assert_allclose(with_measure.center, without.center, rtol=1e-10)


def test_the_best_of_several_trials_competes_with_the_centre() -> None:
    config = TrustRegionConfig(step_fractions=(1.0, 0.5, 0.25))
    state = trust_region.init(START, config)
    state, design = trust_region.tell(state, linear(trust_region.ask(state)), 1.0 / NOISE**2)
    trials = trust_region.ask(state)
    np.testing.assert_allclose(trials[1] - START, 0.5 * (trials[0] - START), rtol=1e-10)
    residuals = linear(trials)
    residuals[0] = 10.0
    state, info = trust_region.tell(state, residuals, 1.0 / NOISE**2)
    assert info.is_accepted
    assert (state.center == trials[1]).all()
    # The ridge takes up to a share of 1e-4 off the slopes.
    np.testing.assert_allclose(info.actual_improvement, info.predicted_improvement, rtol=1e-3)
    assert design.predicted_improvement > info.predicted_improvement


def test_the_radius_grows_on_success_at_the_border_and_shrinks_on_failure() -> None:
    state = trust_region.init(START)
    state, _ = trust_region.tell(state, linear(trust_region.ask(state)), np.full(6, EXACT))
    better, info = trust_region.tell(state, linear(trust_region.ask(state)), np.full(6, EXACT))
    assert info.is_accepted
    np.testing.assert_allclose(info.ratio, 1.0, rtol=1e-3)
    assert better.radius == 2.0 * state.radius
    worse, info = trust_region.tell(state, 3.0 * linear(START[None]), np.full(6, EXACT))
    assert not info.is_accepted
    assert info.ratio < 0.0
    assert worse.radius == 0.5 * state.radius
    assert (worse.center == START).all()


def test_the_prior_enters_actual_and_predicted_improvement_alike() -> None:
    prior = GaussianPrior(np.array([0.9, 0.1, 0.5, 0.2]), 0.3 * np.diag([2.0, 0.5, 1.0, 4.0]) * PRECISION.max())
    state = trust_region.init(START)
    state, _ = trust_region.tell(state, linear(trust_region.ask(state)), 1.0 / NOISE**2, prior=prior)
    _, info = trust_region.tell(state, linear(trust_region.ask(state)), 1.0 / NOISE**2, prior=prior)
    np.testing.assert_allclose(info.actual_improvement, info.predicted_improvement, rtol=1e-3)


@pytest.mark.parametrize(
    ("first", "second", "excess"),
    [
        ((0.9, -0.4), (0.3, 0.8), 1.0),
        ((0.05, -0.1), (-0.1, 0.3), 1.0),
        ((0.0, 0.0), (0.0, 0.0), 1.26),  # nothing but noise: the floor makes the estimate a quarter too large
    ],
)
def test_the_noise_of_a_comparison_is_what_repetition_shows(
    first: tuple[float, ...], second: tuple[float, ...], excess: float
) -> None:
    # 4000 repetitions, seed 2; the standard deviation has a relative standard error of 1 to 2 %, bound 8 %.
    rng = np.random.default_rng(2)
    points, noise = np.array([[0.2, 0.3], [0.2, 0.3], [0.7, 0.4]]), np.array([0.05, 0.1])
    mean = np.array([first, first, second])
    weights = np.broadcast_to(1.0 / noise**2, (3, 2))
    comparisons = [
        compare_points(EvaluatedPoints(points, mean + rng.normal(size=(3, 2)) * noise, weights), points[0], points[2])
        for _ in range(4000)
    ]
    scatter = np.std([comparison.improvement for comparison in comparisons])
    estimate = np.sqrt(np.mean([comparison.standard_deviation**2 for comparison in comparisons]))
    np.testing.assert_allclose(estimate, excess * scatter, rtol=0.08)


def test_the_precision_of_the_parameters_is_reported() -> None:
    prior = GaussianPrior(TRUTH, np.diag([1.0, 2.0, 3.0, 4.0]))
    state = trust_region.init(START)
    _, info = trust_region.tell(state, linear(trust_region.ask(state)), 1.0 / NOISE**2, prior=prior)
    assert info.precision is not None
    np.testing.assert_allclose(info.precision, PRECISION + prior.precision, rtol=1e-3, atol=1e-3 * PRECISION.max())


def test_mistakes_of_the_caller_are_refused() -> None:
    state = trust_region.init(START)
    with pytest.raises(ValueError, match="residuals of 9 candidates"):
        trust_region.tell(state, np.zeros((8, 6)), np.ones(6))
    with pytest.raises(ValueError, match=r"weights of shape \(6,\) or \(9, 6\); got \(5,\)"):
        trust_region.tell(state, np.zeros((9, 6)), np.ones(5))
    with pytest.raises(ValueError, match="finite weights >= 0"):
        trust_region.tell(state, np.zeros((9, 6)), -np.ones(6))
    with pytest.raises(ValueError, match="unit cube"):
        trust_region.init(np.array([0.5, 1.5]))
    with pytest.raises(ValueError, match="least_radius"):
        TrustRegionConfig(initial_radius=0.7)
    with pytest.raises(ValueError, match="reuse_radius"):
        replace(TrustRegionConfig(), reuse_radius=1.0)
