"""Refinement by gradients on a problem whose minimum is a linear least-squares solution."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from jaxcalib.calibration.objective.evidence import Evidence, independent_evidence
from jaxcalib.calibration.stages.gradient_refinement import GradientRefinement, refine
from jaxcalib.calibration.stages.search_box import SearchBox, search_box
from jaxcalib.initial_values.demand_profile import DemandEstimate
from jaxcalib.initial_values.driver_values import DriverEstimate
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.search.least_squares.response_surface import ResponseSurface
from tests.jaxcalib.calibration.toy import SPACE

FITTED = ("tau", "minGap")  # of `main`, `tau`, `minGap`
SHOWN = np.asarray([0.55, 0.30])  # where the pairs are explained best, in the unit cube
ERROR = np.asarray([0.03, 0.05])  # what the jackknife says of it
START = np.asarray([0.45, 0.62, 0.25])
EVIDENCE_ERROR = np.asarray([0.08, 0.01, 0.01])  # that of the fitted ones is the replay itself
BASE = np.asarray([0.4, -0.9, 0.3])
SLOPE = np.asarray([[2.0, 0.4, -0.3], [0.5, 1.6, 0.2], [-0.4, 0.3, 1.9]])
CENTER, RADIUS = np.full(3, 0.5), 0.5
LOW, HIGH = (np.asarray([getattr(one, name) for one in SPACE.ranges[1:]]) for name in ("lower", "upper"))

Loss = Callable[[Array], Array]


def unit_of(values: Array) -> Array:
    return jnp.log(values / LOW) / jnp.log(HIGH / LOW)


def pairs(values: Array) -> Array:
    """Return half of the squared departures in standard errors: the curvature is that of the errors already."""
    return 0.5 * jnp.sum(((unit_of(values) - SHOWN) / ERROR) ** 2)


def half_blind(values: Array) -> Array:
    """Return the same, but hide from automatic derivatives that the second parameter matters."""
    return pairs(jnp.stack([values[0], jax.lax.stop_gradient(values[1])]))


def initial_with(loss: Loss | None, error: np.ndarray = ERROR) -> InitialPoint:
    unit = np.concatenate([[0.5], SHOWN])
    values = SPACE.values_of(unit)
    unit_error = np.concatenate([[0.1], error])
    source = ("scenario", "pairs", "pairs")
    drivers = DriverEstimate(values[1:], error, source[1:], None, 5000, FITTED, loss)
    demand = DemandEstimate(values[:1], np.asarray([50.0]), values[:1], np.asarray([0.15]))
    return InitialPoint(SPACE, values, values, unit_error, source, drivers, demand)


def box_of(*chosen: int) -> SearchBox:
    return search_box(START, chosen, np.full(3, 0.4))


def evidence() -> Evidence:
    return independent_evidence(np.asarray([0.40, 0.9, 0.9]), EVIDENCE_ERROR)


def refined(loss: Loss | None, box: SearchBox, error: np.ndarray = ERROR) -> GradientRefinement | None:
    places = box.chosen
    surface = ResponseSurface(
        center=CENTER[places],
        radius=RADIUS,
        intercept=np.append(BASE, 99.0),  # behind the moments come residuals of the evidence, which count by themselves
        slope=np.vstack([SLOPE[:, places], np.full(len(places), 50.0)]),
        curvature=np.zeros((4, len(places))),
        num_points=20,
        slope_covariance=np.zeros((4, len(places), len(places))),
    )
    return refine(START, initial_with(loss, error), evidence(), surface, box, num_moments=3)


def least_squares(box: SearchBox, free: np.ndarray) -> np.ndarray:
    """Return the minimum over the free parameters; the others stay at the start."""
    moments = np.zeros((3, 3))
    moments[:, box.chosen] = SLOPE[:, box.chosen] / (box.upper - box.lower) / RADIUS
    at_start = BASE + SLOPE[:, box.chosen] @ (
        ((START[box.chosen] - box.lower) / box.width - CENTER[box.chosen]) / RADIUS
    )
    rows = np.vstack([moments, np.eye(3)[:1] / EVIDENCE_ERROR[0], np.eye(3)[1:] / ERROR[:, None]])
    right = np.concatenate([at_start, [(START[0] - 0.40) / EVIDENCE_ERROR[0]], (START[1:] - SHOWN) / ERROR])
    change = np.zeros(3)
    change[free] = np.linalg.lstsq(rows[:, free], -right, rcond=None)[0]
    return START + change


def test_the_minimum_of_moments_evidence_and_pairs_together_is_found() -> None:
    box = box_of(0, 1, 2)
    found = refined(pairs, box)
    assert found is not None
    assert found.is_usable == (True, True)
    assert found.names == FITTED
    # Adam's steps shrink from 2e-3 to nothing
    np.testing.assert_allclose(found.unit, least_squares(box, np.ones(3, bool)), atol=2e-3)
    assert found.after < found.before


def test_a_parameter_whose_derivative_is_wrong_keeps_its_value() -> None:
    box = box_of(0, 1, 2)
    found = refined(half_blind, box)
    assert found is not None
    assert found.is_usable == (True, False)
    assert found.disagreement[0] < 0.01
    assert found.disagreement[1] == pytest.approx(1.0, abs=0.01)
    assert found.unit[2] == pytest.approx(START[2], abs=1e-6)
    np.testing.assert_allclose(found.unit, least_squares(box, np.asarray([True, True, False])), atol=2e-3)


def test_parameters_that_are_neither_searched_nor_shown_by_the_pairs_keep_their_values() -> None:
    found = refined(pairs, box_of(1, 2))
    assert found is not None
    assert found.unit[0] == pytest.approx(START[0], abs=1e-6)
    assert np.abs(found.unit[1:] - START[1:]).min() > 0.01


def test_the_pairs_weigh_what_their_errors_say_whatever_the_loss_is_measured_in() -> None:
    box = box_of(0, 1, 2)
    one, other = refined(pairs, box), refined(lambda values: 7.3 * pairs(values), box)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(other.unit, one.unit, atol=1e-4)


def test_without_pairs_or_without_their_errors_there_is_nothing_to_refine() -> None:
    assert refined(None, box_of(0, 1, 2)) is None
    assert refined(pairs, box_of(0, 1, 2), np.full(2, np.inf)) is None
