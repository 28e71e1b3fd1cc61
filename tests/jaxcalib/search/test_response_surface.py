import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.search import GaussianPrior
from jaxcalib.search.least_squares.response_surface import ResponseSurface, fit_response_surface
from jaxcalib.search.least_squares.surface_step import levenberg_marquardt_step, predicted_misfit
from jaxcalib.search.trust_region.local_design import local_design

CENTER = np.array([0.31, 0.62, 0.44])
INTERCEPT = np.array([0.7, -1.3])
SLOPE = np.array([[1.2, -0.4, 0.3], [0.2, 0.9, -1.1]])
CURVATURE = np.array([[0.5, -0.2, 0.8], [0.1, 0.3, -0.6]])


def surface(center: np.ndarray = CENTER, *, curved: bool = False) -> ResponseSurface:
    curvature = CURVATURE if curved else np.zeros((2, 3))
    return ResponseSurface(center, 0.2, INTERCEPT, SLOPE, curvature, 7, np.zeros((2, 3, 3)))


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6),
    st.floats(0.001, 0.5),
    st.sampled_from(["central", "two_level"]),
    st.integers(0, 9),
)
def test_designs_stay_in_the_unit_cube_and_hold_the_centre(
    center: list[float], radius: float, kind: str, i: int
) -> None:
    point = np.array(center)
    design = local_design(point, radius, "central" if kind == "central" else "two_level", i)
    assert (design[0] == point).all()
    assert ((design >= 0.0) & (design <= 1.0)).all()
    # Slopes can be told apart, even at a bound: the design around the centre is never cut off.
    steps = (design[1:] - design[1:].mean(axis=0)) / radius
    assert np.linalg.matrix_rank(steps, tol=0.1) == len(center)
    np.testing.assert_allclose(np.ptp(design[1:], axis=0), 2.0 * radius, rtol=1e-9)
    assert np.abs(design - point).max() <= 2.0 * radius + 1e-12


def test_successive_two_level_designs_are_folded_over() -> None:
    center = np.full(5, 0.45)
    first, second = (local_design(center, 0.1, "two_level", i)[1:] - center for i in (0, 1))
    np.testing.assert_allclose(first, -second, atol=1e-12)


@pytest.mark.parametrize("is_quadratic", [False, True])
def test_a_surface_of_its_own_kind_is_recovered(is_quadratic: bool) -> None:
    truth = surface(curved=is_quadratic)
    points = local_design(CENTER, 0.2, "central", 0)
    residuals = np.array([truth.residual_at((point - CENTER) / 0.2) for point in points])
    weights = np.random.default_rng(0).uniform(0.2, 3.0, size=residuals.shape)
    fitted = fit_response_surface(points, residuals, weights, CENTER, 0.2, is_quadratic=is_quadratic, ridge=0.0)
    np.testing.assert_allclose(fitted.intercept, INTERCEPT, rtol=1e-10)
    np.testing.assert_allclose(fitted.slope, SLOPE, rtol=1e-10)
    np.testing.assert_allclose(fitted.curvature, truth.curvature, rtol=1e-9, atol=1e-10)


def test_the_fit_is_weighted_least_squares() -> None:
    rng = np.random.default_rng(1)
    points, residuals = rng.random((9, 3)), rng.normal(size=(9, 2))
    weights = rng.uniform(0.0, 2.0, size=(9, 2))
    weights[4, 1] = 0.0
    residuals[4, 1] = 1e6  # left out
    fitted = fit_response_surface(points, residuals, weights, CENTER, 0.2, ridge=0.0)
    for measure in range(2):
        root = np.sqrt(weights[:, measure])
        design = np.hstack([np.ones((9, 1)), (points - CENTER) / 0.2]) * root[:, None]
        expected = np.linalg.lstsq(design, residuals[:, measure] * root, rcond=None)[0]
        np.testing.assert_allclose([fitted.intercept[measure], *fitted.slope[measure]], expected, rtol=1e-9)


def test_errors_of_slopes_are_those_of_repeated_fits() -> None:
    rng = np.random.default_rng(2)
    points, weights = rng.random((14, 3)), rng.uniform(0.5, 2.0, size=(14, 2))
    noise = np.array([0.3, 1.1])
    clean = np.array([surface().residual_at((point - CENTER) / 0.2) for point in points])

    def fit() -> ResponseSurface:
        scatter = noise * rng.normal(size=(14, 2)) / np.sqrt(weights)
        return fit_response_surface(points, clean + scatter, weights, CENTER, 0.2, ridge=0.0)

    fits = [fit() for _ in range(3000)]
    claimed = np.mean([one.slope_covariance for one in fits], axis=0)
    for measure in range(2):
        found = np.cov([one.slope[measure] for one in fits], rowvar=False)
        np.testing.assert_allclose(claimed[measure], found, rtol=0.1, atol=0.05 * np.abs(found).max())


def test_as_many_points_as_coefficients_say_nothing_of_the_errors_of_slopes() -> None:
    points = np.random.default_rng(3).random((4, 3))
    assert np.isinf(fit_response_surface(points, points @ SLOPE.T, np.ones((4, 2)), CENTER, 0.2).slope_covariance).all()


def test_directions_that_no_point_shows_get_no_slope() -> None:
    points = CENTER + np.outer([0.0, 0.1, -0.1], [1.0, 0.0, 0.0])
    fitted = fit_response_surface(points, points @ SLOPE.T, np.ones((3, 2)), CENTER, 0.2)
    np.testing.assert_allclose(fitted.slope[:, 1:], 0.0, atol=1e-10)
    np.testing.assert_allclose(fitted.slope[:, 0], 0.2 * SLOPE[:, 0], rtol=1e-3)  # the ridge takes up to 1e-4


def test_the_step_on_a_linear_surface_with_a_prior_is_the_posterior_mode() -> None:
    weights, precision = np.array([2.0, 5.0]), np.array([[9.0, 1.0, 0.5], [1.0, 7.0, -2.0], [0.5, -2.0, 30.0]])
    prior = GaussianPrior(np.array([0.35, 0.6, 0.4]), 30.0 * precision)
    step = levenberg_marquardt_step(surface(), weights, prior, damping=0.0)
    jacobian = SLOPE / 0.2
    information = (jacobian.T * weights) @ jacobian + prior.precision
    gradient = (jacobian.T * weights) @ INTERCEPT + prior.precision @ (CENTER - prior.mean)
    np.testing.assert_allclose(step.candidate, CENTER - np.linalg.solve(information, gradient), rtol=1e-9)
    assert np.abs(step.step).max() < 1.0  # no bound was active


@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3), st.booleans(), st.floats(0.0, 10.0))
def test_steps_stay_in_region_and_cube_and_never_raise_the_misfit(
    center: list[float], curved: bool, damping: float
) -> None:
    weights = np.array([0.7, 1.9])
    local = surface(np.array(center), curved=curved)
    step = levenberg_marquardt_step(local, weights, damping=damping)
    assert (np.abs(step.step) <= 1.0 + 1e-12).all()
    assert ((step.candidate >= 0.0) & (step.candidate <= 1.0)).all()
    improvement = predicted_misfit(local, np.zeros(3), weights, None) - predicted_misfit(
        local, step.step, weights, None
    )
    np.testing.assert_allclose(step.predicted_improvement, max(0.0, improvement), atol=1e-12)
    assert improvement >= -1e-12


@pytest.mark.parametrize("damping", [0.0, 0.8])
def test_the_step_on_a_quadratic_surface_is_a_minimum_of_misfit_plus_damping(damping: float) -> None:
    weights = np.array([0.7, 1.9])
    local = surface(curved=True)
    penalty = damping * (weights @ SLOPE**2).sum() / 3

    def damped(step: np.ndarray) -> float:
        return predicted_misfit(local, step, weights, None) + penalty * float(step @ step)

    step = levenberg_marquardt_step(local, weights, damping=damping).step
    for nearby in np.random.default_rng(3).normal(0.0, 0.05, size=(200, 3)):
        assert damped(np.clip(step + nearby, -1.0, 1.0)) >= damped(step) - 1e-9


def test_more_damping_means_shorter_steps() -> None:
    lengths = [np.linalg.norm(levenberg_marquardt_step(surface(), np.ones(2), None, d).step) for d in (0.0, 0.5, 5.0)]
    assert lengths[0] > lengths[1] > lengths[2] > 0.0


def test_a_flat_surface_gives_no_step() -> None:
    flat = ResponseSurface(CENTER, 0.2, INTERCEPT, np.zeros((2, 3)), np.zeros((2, 3)), 7, np.zeros((2, 3, 3)))
    step = levenberg_marquardt_step(flat, np.ones(2))
    assert (step.step == 0.0).all()
    assert step.predicted_improvement == 0.0


def test_a_prior_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="positive semi-definite"):
        GaussianPrior(np.zeros(2), np.array([[1.0, 0.0], [0.0, -1.0]]))
    with pytest.raises(ValueError, match="symmetric"):
        GaussianPrior(np.zeros(2), np.array([[1.0, 0.5], [0.0, 1.0]]))
    with pytest.raises((ValueError, TypeError), match=r"square matrix|precision"):  # TypeError: annotations checked
        GaussianPrior(np.zeros(2), np.eye(3))
