import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.calibration.objective.evidence import independent_evidence
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.local_surface import local_surface
from jaxcalib.calibration.stages.optimisation import could_be_lower, optimise, polish, polish_config, polish_on
from jaxcalib.calibration.stages.screening import screen, smallest_array
from jaxcalib.calibration.stages.search_box import half_width_of, search_box
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.search import TrustRegionConfig
from jaxcalib.search.least_squares.response_surface import ResponseSurface
from jaxcalib.search.optimiser import Setting
from jaxcalib.search.optimisers.saga import Saga
from tests.jaxcalib.calibration.toy import RESPONSE, SPACE, TRUTH, ToySimulator, starts_at, toy_objective, toy_run

WHOLE = search_box(np.full(3, 0.5), range(3), np.full(3, 0.5))
START = np.full(3, 0.5)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3),
    st.lists(st.floats(0.001, 0.6), min_size=3, max_size=3),
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2),
)
def test_a_box_stays_in_the_cube_and_holds_what_it_does_not_search(
    center: list[float], half: list[float], point: list[float]
):
    box = search_box(np.asarray(center), [0, 2], np.asarray(half))
    unit = box.unit_of(np.asarray([point]))
    assert ((unit >= -1e-12) & (unit <= 1.0 + 1e-12)).all()
    assert unit[0, 1] == center[1]
    assert box.box_of(unit)[0] == pytest.approx(point, abs=1e-9)


def test_known_parameters_are_searched_three_errors_around_and_unknown_ones_widely():
    found = half_width_of(np.asarray([0.05, np.inf, 1e-6, 0.4]))
    assert found == pytest.approx([0.15, 0.35, 0.01, 0.5])


def test_screening_finds_the_planted_truth():
    found = screen(toy_run(), WHOLE, START, 8, 2, "explore", 0.9)
    assert found.array.name.startswith("L16")
    assert found.best == pytest.approx(TRUTH, abs=0.2)
    assert found.best_accuracy > found.cases.accuracy[-1]  # better than the initial point, the last case


def test_a_failing_region_never_wins_and_never_enters_a_mean():
    simulator = ToySimulator(failing=(0.55, 0.7))  # where the truth lies
    found = screen(toy_run(simulator), WHOLE, START, 4, 2, "explore", 0.9)
    assert not 0.55 <= found.best[1] <= 0.7
    failed = ~found.cases.is_ok
    assert failed.any()
    assert np.isfinite(found.ranges.level_mean_accuracy[[0, 2]]).all()


def test_saga_and_polish_come_closer_to_the_truth():
    run = toy_run()
    saga = optimise(run, WHOLE, Saga(), Setting(3, 80, 8, START, False, 3), 8, "optimise")
    assert np.abs(saga.best - TRUTH).max() < 0.25
    done = polish(run, WHOLE, saga.best, 32, TrustRegionConfig(num_iterations=3), "optimise", saga.rounds)
    assert np.abs(done.best - TRUTH).max() < 0.12


def test_evidence_of_the_logs_holds_what_the_moments_hardly_show():
    evidence = independent_evidence(TRUTH, np.full(3, 0.01))
    run = toy_run(objective=toy_objective(evidence, num_drives=2))
    done = polish(run, WHOLE, TRUTH + 0.05, 16, TrustRegionConfig(num_iterations=2), "optimise")
    assert np.abs(done.best - TRUTH).max() < 0.03


def test_a_polish_goes_on_as_long_as_parameters_explain_residuals():
    """The truth lies 0.3 from the start, outside of the first box of 0.1 around it."""
    start, half_width = TRUTH + np.asarray([0.3, -0.3, 0.3]), np.full(3, 0.1)
    weak = independent_evidence(TRUTH, np.full(3, 1.0))  # residuals more than parameters, so that something is left
    run = toy_run(objective=toy_objective(weak, num_drives=400))
    once, _ = polish_on(run, start, half_width, 128, polish_config(0.25), "optimise", most=1)
    often, box = polish_on(run, start, half_width, 128, polish_config(0.25), "optimise", most=20)
    assert np.abs(once.best - TRUTH).max() > 0.1
    assert np.abs(often.best - TRUTH).max() < 0.1
    assert once.is_on_its_way
    assert not often.is_on_its_way
    assert len(often.rounds) < 2 * 20, "it ended by itself"
    assert box.holds(often.best[None]).all()


def test_a_polish_at_the_truth_seldom_goes_on():
    """Moments and evidence as chance makes them: as many residuals as parameters would never lead on."""
    goes_on, error = [], np.full(3, 0.3)
    for seed in range(60):
        known = TRUTH + error * np.random.default_rng(seed).standard_normal(3)
        objective = toy_objective(independent_evidence(known, error), num_drives=4000)
        run = SearchRun(Evaluator(ToySimulator(), starts_at(300.0, 320.0), 1000 * seed), SPACE, objective)
        done, _ = polish_on(run, TRUTH, np.full(3, 0.05), 32, polish_config(0.25), "optimise", most=20)
        assert not done.is_on_its_way
        goes_on.append(len(done.rounds) > 2)
    assert np.mean(goes_on) < 0.1


def _surface(residual: np.ndarray, slope: np.ndarray) -> ResponseSurface:
    curvature, covariance = np.zeros_like(slope), np.zeros((*slope.shape, slope.shape[1]))
    return ResponseSurface(np.full(slope.shape[1], 0.5), 0.1, residual, slope, curvature, 40, covariance)


def test_chance_alone_seldom_says_that_residuals_could_be_lower_however_many_remain():
    random = np.random.default_rng(4)
    for scale in (1.0, 3.0):  # 3: something remains that no parameter explains
        says = [
            could_be_lower(_surface(scale * random.standard_normal(50), random.standard_normal((50, 12))))
            for _ in range(400)
        ]
        assert np.mean(says) == pytest.approx(0.05, abs=0.035)


def test_residuals_along_the_slopes_could_be_lower():
    random = np.random.default_rng(4)
    slope = np.vstack([random.standard_normal((50, 12)), np.zeros((30, 12))])  # 30 that no parameter moves
    residual = random.standard_normal(80) + slope @ np.full(12, 0.5)
    assert could_be_lower(_surface(residual, slope))
    assert not could_be_lower(_surface(residual, np.zeros_like(slope)))
    assert not could_be_lower(_surface(residual[:12], slope[:12])), "as many parameters as residuals explain all"


def test_surface_through_all_candidates_knows_the_slopes():
    run = toy_run()
    judged = [run.judge(np.random.default_rng(5).uniform(0.3, 0.7, (60, 3)), 16, "explore")]
    surface = local_surface(run.objective, WHOLE, judged, START)
    jacobian = surface.slope / surface.radius
    factor = np.linalg.cholesky(run.objective.variance(100_000))
    assert factor @ jacobian == pytest.approx(RESPONSE, abs=0.25)


@pytest.mark.parametrize(("number", "cases"), [(2, 16), (5, 16), (6, 64), (12, 64), (21, 64), (22, 81), (40, 81)])
def test_the_array_is_the_smallest_that_fits(number: int, cases: int):
    array = smallest_array(number)
    assert (array.num_cases, array.num_factors) == (cases, number)
