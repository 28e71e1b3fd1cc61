"""How well the data know the parameters."""

import numpy as np

from jaxcalib.calibration.result.uncertainty import birge_ratio, information_of
from jaxcalib.search.least_squares.response_surface import ResponseSurface, fit_response_surface

NUM_MOMENTS, NUM_PARAMETERS, NUM_POINTS = 60, 5, 24
RADIUS = 0.5
CENTER = np.full(NUM_PARAMETERS, 0.45)
EVIDENCE = np.diag([0.0, 3.0, 0.0, 0.7, 0.0])  # residuals per unit of a step


def fitted(slope: np.ndarray, seed: int, noise: float) -> ResponseSurface:
    """Return a surface through noisy moments and exact evidence."""
    rng = np.random.default_rng(seed)
    points = rng.random((NUM_POINTS, NUM_PARAMETERS))
    steps = (points - CENTER) / RADIUS
    moments = steps @ slope.T + noise * rng.normal(size=(NUM_POINTS, NUM_MOMENTS))
    residuals = np.hstack([moments, steps @ EVIDENCE.T])
    return fit_response_surface(points, residuals, np.ones_like(residuals), CENTER, RADIUS, ridge=0.0)


def test_slopes_that_are_noise_are_no_knowledge() -> None:
    surfaces = [fitted(np.zeros((NUM_MOMENTS, NUM_PARAMETERS)), seed, 1.0) for seed in range(30)]
    naive = np.mean([np.diag(one.slope.T @ one.slope) for one in surfaces], axis=0)
    corrected = np.mean([np.diag(information_of(one, NUM_MOMENTS)) for one in surfaces], axis=0)
    exact = np.diag(EVIDENCE) ** 2
    assert (naive - exact > 5.0).all()  # the moments seem to know something
    assert (np.abs(corrected - exact) < 0.35 * (naive - exact)).all()


def test_information_of_moments_and_of_the_logs_adds_up() -> None:
    slope = np.random.default_rng(9).normal(size=(NUM_MOMENTS, NUM_PARAMETERS))
    exact = slope.T @ slope + EVIDENCE.T @ EVIDENCE
    np.testing.assert_allclose(information_of(fitted(slope, 1, 0.0), NUM_MOMENTS), exact, rtol=1e-6, atol=1e-6)
    noisy = np.mean([information_of(fitted(slope, seed, 0.5), NUM_MOMENTS) for seed in range(40)], axis=0)
    np.testing.assert_allclose(noisy, exact, rtol=0.1, atol=3.0)


def test_no_direction_gets_less_than_the_logs_say() -> None:
    for seed in range(20):
        information = information_of(fitted(np.zeros((NUM_MOMENTS, NUM_PARAMETERS)), seed, 2.0), NUM_MOMENTS)
        assert np.linalg.eigvalsh(information - EVIDENCE.T @ EVIDENCE).min() > -1e-6


def test_moments_that_are_off_by_more_than_noise_know_less_and_the_logs_as_much() -> None:
    slope = np.random.default_rng(9).normal(size=(NUM_MOMENTS, NUM_PARAMETERS))
    of_logs = EVIDENCE.T @ EVIDENCE
    once, thrice = (information_of(fitted(slope, 1, 0.0), NUM_MOMENTS, excess) for excess in (1.0, 3.0))
    np.testing.assert_allclose(thrice - of_logs, (once - of_logs) / 9.0, rtol=1e-6, atol=1e-9)


def test_the_ratio_is_what_residuals_have_beyond_their_noise() -> None:
    residuals, relative_noise = np.asarray([3.0, -1.0, 2.0, -2.0]), 0.06
    accuracy = 1.0 - relative_noise * float(np.sqrt(np.mean(residuals**2)))  # as `Objective.accuracy` has it
    np.testing.assert_allclose(birge_ratio(accuracy, relative_noise), np.sqrt(4.5))
    assert birge_ratio(0.97, relative_noise) == 1.0
