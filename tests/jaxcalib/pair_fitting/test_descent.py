"""Levenberg-Marquardt steps on residuals whose least sum of squares is known."""

import numpy as np
import pytest

from jaxcalib.pair_fitting.batch import Misfit
from jaxcalib.search.least_squares.levenberg_marquardt import DAMPING_FACTORS, Descent, begin, descend

VALLEY = np.asarray([[0.62, 0.31], [0.44, 0.75], [0.2, 0.9]]).T  # of three problems


def misfit_of(unit: np.ndarray) -> Misfit:
    """Rosenbrock's valley, bent and narrow, around a point of its own for each problem; dampings side by side."""
    centre = np.tile(VALLEY, unit.shape[1] // VALLEY.shape[1])
    x, y = unit - centre
    residuals = np.stack([20.0 * (y - 3.0 * x**2), x])
    slopes = np.stack([np.stack([-120.0 * x, np.ones_like(x)]), np.stack([np.full_like(x, 20.0), np.zeros_like(x)])])
    return Misfit(
        total=(residuals**2).sum(axis=0),
        gradient=(slopes * residuals).sum(axis=1),
        product=np.einsum("prn,qrn->pqn", slopes, slopes),
        lag_product=np.zeros_like(x),
        smallest_gap_m=np.ones_like(x),
    )


def started() -> Descent[Misfit]:
    unit = np.full_like(VALLEY, 0.5)
    return begin(unit, misfit_of(unit))


@pytest.mark.parametrize("num_dampings", [1, len(DAMPING_FACTORS)])
def test_the_bottom_of_a_bent_valley_is_found(num_dampings: int) -> None:
    found = descend(misfit_of, started(), 40, num_dampings)
    assert found.unit == pytest.approx(VALLEY, abs=1e-5)
    assert found.found.total == pytest.approx(np.zeros(3), abs=1e-9)


def test_dampings_side_by_side_come_no_less_far_in_one_step() -> None:
    """The first of them is the damping that a single one has."""
    alone = descend(misfit_of, started(), 1)
    together = descend(misfit_of, started(), 1, len(DAMPING_FACTORS))
    assert (together.found.total <= alone.found.total).all()
    assert (together.found.total < alone.found.total).any()


def test_points_that_fail_are_never_taken() -> None:
    def fails_beyond(unit: np.ndarray) -> Misfit:
        found = misfit_of(unit)
        bad = np.abs(unit - 0.5).max(axis=0) > 0.05
        return Misfit(
            np.where(bad, np.nan, found.total), found.gradient, found.product, found.lag_product, found.smallest_gap_m
        )

    start = started()
    found = descend(fails_beyond, start, 12, len(DAMPING_FACTORS))
    assert np.isfinite(found.found.total).all()
    assert (found.found.total < start.found.total).any()
    assert (np.abs(found.unit - 0.5) <= 0.05).all()
