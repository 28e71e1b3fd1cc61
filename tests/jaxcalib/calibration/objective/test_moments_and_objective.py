from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.discrepancy import Confirmed, learn_discrepancy
from jaxcalib.calibration.objective.evidence import SCENARIO_ERROR, evidence_of, independent_evidence
from jaxcalib.calibration.objective.moments import Moments, all_moments, noise_covariance, observed_moments
from jaxcalib.calibration.objective.objective import MODEL_ERROR, Objective
from jaxcalib.errors import CaseError
from jaxcalib.initial_values.demand_profile import DemandEstimate
from jaxcalib.measures.measure import LeftOut, Level, Measure, Percentile
from jaxcalib.problem.parameter_space import ParameterSpace, Range
from sim_adapters.interface import ParameterLayout
from tests.jaxcalib.calibration.toy import NOISE, OFFSET, RESPONSE, SPACE, TRUTH, tallies, toy_moments, toy_objective


def ratio_tallies(num_runs: int, seed: int) -> np.ndarray:
    """Return two ratios whose denominators vary between runs, and the number of drives."""
    rng = np.random.default_rng(seed)
    below = rng.uniform(50.0, 150.0, (num_runs, 2))
    above = below * (np.asarray([2.0, 0.5]) + 0.2 * rng.standard_normal((num_runs, 2)))
    return np.hstack([above, below, np.ones((num_runs, 1))])


def two_ratios() -> Moments:
    return Moments(("a", "b"), (Level.TRAFFIC,) * 2, np.asarray([0, 1]), np.asarray([2, 3]), np.asarray([1.0, 3.6]), 4)


def test_a_user_may_have_further_measures_matched():
    def measure(name: str, **options: Any) -> Measure:
        return Measure(name, "", Level.VEHICLE, "above", "below", **options)

    median = Percentile("median", "", Level.VEHICLE, "bins", "below", borders=(0.0, 1.0))
    several = {one.name: one for one in (measure("speed"), measure("near_misses", left_out=LeftOut.SAFETY), median)}
    index = {"above": 0, "below": 1, "drives": 2}
    assert all_moments(several, index).names == ("speed",)
    assert all_moments(several, index, ["near_misses"]).names == ("speed", "near_misses")
    with pytest.raises(CaseError, match='also_match: expected measures such as near_misses; got "near_miss": there is'):
        all_moments(several, index, ["near_miss"])
    with pytest.raises(CaseError, match="it is no mean"):
        all_moments(several, index, ["median"])


def test_noise_of_pooled_ratios_agrees_with_their_scatter():
    moments = two_ratios()
    pooled = np.stack([moments.values(ratio_tallies(16, seed).sum(axis=0)) for seed in range(400)])
    covariance = noise_covariance(moments, ratio_tallies(4000, 999)) / 16
    assert np.sqrt(np.diag(covariance)) == pytest.approx(pooled.std(axis=0), rel=0.1)


def test_influences_add_up_to_nothing_and_a_moment_without_observations_is_nan():
    runs = ratio_tallies(7, 3)
    assert two_ratios().influence(runs).sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    runs[:, 2] = 0.0
    assert np.isnan(two_ratios().values(runs.sum(axis=0))[0])


def test_a_moment_that_rests_on_one_drive_is_left_out():
    field, simulated = ratio_tallies(8, 1), ratio_tallies(32, 2)
    field[1:, 3] = 0.01
    assert observed_moments(two_ratios(), field, simulated).names == ("a",)


def test_a_rate_of_events_counts_by_its_events_and_not_by_the_metres_driven():
    rates = replace(two_ratios(), rates=frozenset("b"))
    field, simulated = ratio_tallies(8, 1), ratio_tallies(32, 2)
    assert observed_moments(rates, field, simulated).names == ("a", "b")
    field[:, 1], simulated[:, 1] = 0.0, 0.0
    simulated[3, 1] = 1.0  # one event in 32 runs: neither side says anything
    assert observed_moments(rates, field, simulated).names == ("a",)
    simulated[:, 1] = 2.0  # 16 events expected, none seen
    assert observed_moments(rates, field, simulated).names == ("a", "b")


def test_events_of_a_drive_count_where_one_side_shows_them():
    counts = replace(two_ratios(), denominator=np.asarray([2, 4]))
    field, simulated = ratio_tallies(8, 1), ratio_tallies(32, 2)
    field[:, 1] = [1, 4, 0, 2, 2, 1, 0, 2]
    simulated[:, 1] = 0.0
    simulated[:8, 1] = 1.0  # two events in as many drives as the field's
    assert observed_moments(counts, field, simulated).names == ("a", "b")
    field[:, 1] = [1, 1, 0, 0, 1, 0, 0, 0]
    assert observed_moments(counts, field, simulated).names == ("a",)


def test_relative_errors_need_events_on_both_sides():
    counts = replace(two_ratios(), denominator=np.asarray([2, 4]))
    field, simulated = ratio_tallies(8, 1), ratio_tallies(32, 2)
    field[:, 1], simulated[:, 1] = 0.0, 2.0  # a relative error would be infinite
    assert observed_moments(counts, field, simulated).names == ("a", "b")
    assert observed_moments(counts, field, simulated, on_both_sides=True).names == ("a",)
    field[:, 1] = 1.0
    assert observed_moments(counts, field, simulated, on_both_sides=True).names == ("a", "b")


def test_a_count_varies_at_least_as_the_field_shows_it():
    counts = replace(two_ratios(), denominator=np.asarray([2, 4]), scale=np.ones(2))
    simulated = ratio_tallies(400, 2)
    simulated[:, 1] = np.random.default_rng(3).poisson(0.05, 400)
    simulated[:, 0] += 30.0 * simulated[:, 1]
    plain = noise_covariance(counts, simulated)
    often = noise_covariance(counts, simulated, np.asarray([9.0, 1.5]))
    assert plain[1, 1] == pytest.approx(0.05, rel=0.4)
    assert often[1, 1] == pytest.approx(1.5, rel=0.2)
    assert often[0, 0] == plain[0, 0]  # a mean is no count
    assert often[0, 1] == plain[0, 1] != 0.0  # more variance, but no more correlation
    assert noise_covariance(counts, simulated, np.asarray([9.0, 0.01])) == pytest.approx(plain)
    crowds = simulated.copy()
    crowds[:, 1] = 12.0 * np.random.default_rng(4).poisson(0.5, 400)  # counts that come in dozens
    assert noise_covariance(counts, crowds, np.asarray([9.0, 12.0]))[1, 1] == pytest.approx(2 * 72.0, rel=0.2)


def test_a_count_that_simulation_never_shows_is_matched_with_the_fields_noise():
    counts = replace(two_ratios(), denominator=np.asarray([2, 4]), scale=np.ones(2))
    field, simulated = ratio_tallies(8, 1), ratio_tallies(32, 2)
    field[:, 1], simulated[:, 1] = [1, 4, 0, 2, 2, 1, 0, 2], 0.0
    observed = observed_moments(counts, field, simulated)
    assert observed.names == ("a", "b")
    covariance = noise_covariance(observed, simulated, observed.values(field.sum(axis=0)))
    assert covariance[1, 1] == pytest.approx(1.5)
    assert covariance[0, 1] == 0.0


def test_truth_shows_residuals_as_large_as_their_noise():
    squares = []
    for seed in range(300):
        field = np.mean([tallies(TRUTH, 10_000 + 50 * seed + drive) for drive in range(8)], axis=0)
        objective = Objective(
            toy_moments(), toy_moments().values(field), np.diag(NOISE**2), OFFSET, 8,
            independent_evidence(np.full(3, 0.5), np.full(3, np.inf)),
        )  # fmt: skip
        simulated = np.mean([tallies(TRUTH, 90_000 + 50 * seed + run) for run in range(16)], axis=0)
        squares.append(np.mean(objective.residuals(TRUTH[None], simulated[None], 16) ** 2))
    noise, value = NOISE**2 * (1 / 8 + 1 / 16), OFFSET + RESPONSE @ TRUTH
    expected = np.mean(noise / (noise + (MODEL_ERROR * value) ** 2))  # 1, but for the model error beside the noise
    assert np.mean(squares) == pytest.approx(expected, rel=0.12)


def test_a_moment_that_a_candidate_never_shows_says_neither_for_nor_against_it():
    objective, simulated = toy_objective(), tallies(TRUTH, 1)
    simulated[[1, 5]] = 0.0  # of the second moment, no observation
    usual = simulated.copy()
    usual[[1, 5]] = OFFSET[1], 1.0
    failed = np.full_like(simulated, np.nan)
    never, as_usual, none = objective.residuals(np.stack([TRUTH] * 3), np.stack([simulated, usual, failed]), 8)
    assert never == pytest.approx(as_usual)
    assert np.isnan(none[: len(OFFSET)]).all()


def test_what_stands_for_a_moment_never_shown_is_corrected_as_all_others():
    """The usual value is the simulator's own, so what the simulator lacks is added to it, too."""
    added = SimpleNamespace(
        predict=lambda unit: np.tile([0.4, -0.3, 0.2, 0.1], (len(unit), 1)), variance=lambda: NOISE**2
    )
    objective = replace(toy_objective(), discrepancy=added)
    never, as_usual = tallies(TRUTH, 1), tallies(TRUTH, 1)
    never[[1, 5]], as_usual[[1, 5]] = 0.0, (OFFSET[1], 1.0)
    first, second = objective.residuals(np.stack([TRUTH] * 2), np.stack([never, as_usual]), 8)
    assert first == pytest.approx(second)


def test_evidence_of_the_logs_counts_in_its_own_errors():
    evidence = independent_evidence(np.asarray([0.5, 0.6, 0.5]), np.asarray([np.inf, 0.05, 0.1]))
    objective = toy_objective(evidence)
    unit = np.asarray([[0.2, 0.7, 0.3]])
    residuals = objective.residuals(unit, tallies(unit[0], 1)[None], 8)
    assert residuals.shape == (1, 4 + 2)
    assert residuals[0, 4:] == pytest.approx([2.0, -2.0])


def test_inputs_are_known_from_the_scenario_and_drivers_from_the_logs_or_the_scenario():
    """Two inputs that are a fifth above the scenario together are likelier than one above and one below it."""
    space = ParameterSpace(
        ParameterLayout(("main", "on"), (("f",), ("g",)), ("car",), ("tau", "minGap")),
        (Range(1000.0, 2000.0), Range(100.0, 500.0), Range(0.4, 3.0, True), Range(0.5, 6.0, True)),
    )
    demand = DemandEstimate(
        np.asarray([1500.0, 300.0]), np.full(2, 30.0), np.asarray([1400.0, 250.0]), np.full(2, 0.15)
    )
    initial = SimpleNamespace(
        space=space, values=np.asarray([1500.0, 300.0, 1.1, 2.0]), demand=demand,
        unit_error=np.asarray([0.03, 0.075, 0.02, np.inf]),
    )  # fmt: skip
    evidence = evidence_of(initial)  # pyright: ignore[reportArgumentType]
    at = np.asarray([[1400.0, 250.0, 1.1, 2.0], [1680.0, 300.0, 1.1, 2.0], [1680.0, 200.0, 1.1, 2.0]])
    nothing, common, apart = np.sum(evidence.residuals(np.stack([space.unit_of(one) for one in at])) ** 2, axis=1)
    assert nothing == pytest.approx(0.0, abs=1e-12)
    assert common == pytest.approx(0.2**2 / (0.5**2 + 0.15**2 / 2))
    assert apart == pytest.approx(2 * 0.2**2 / 0.15**2)
    drivers = evidence.residuals(space.unit_of(at[0])[None] + np.asarray([[0.0, 0.0, 0.01, 0.1]]))
    assert np.sum(drivers**2) == pytest.approx((0.01 / 0.02) ** 2 + (0.1 / SCENARIO_ERROR) ** 2)


def test_relative_objective_is_the_mean_or_the_printed_sum_of_relative_errors():
    simulated = tallies(TRUTH, 1)
    for is_summed in (False, True):
        objective = Objective(
            toy_moments(), OFFSET, np.diag(NOISE**2), OFFSET, 8, independent_evidence(TRUTH, np.full(3, np.inf)),
            is_relative=True, is_summed=is_summed,
        )  # fmt: skip
        errors = np.abs(toy_moments().values(simulated) - OFFSET) / OFFSET
        expected = 1.0 - (errors.sum() if is_summed else errors.mean())
        residuals = objective.residuals(TRUTH[None], simulated[None], 1)
        assert objective.accuracy(residuals)[0] == pytest.approx(expected)


def test_a_planted_discrepancy_is_learnt_and_noise_is_not_taken_for_one():
    rng = np.random.default_rng(8)
    units = rng.uniform(0.2, 0.8, (4, 3))

    def confirmed(bias: float) -> list[Confirmed]:
        pairs = []
        for number, unit in enumerate(units):
            sumo = np.mean([tallies(unit, 100 * number + run) for run in range(16)], axis=0)
            ours = np.mean([tallies(unit, 5000 + 100 * number + run) for run in range(64)], axis=0)
            sumo[0] += bias * NOISE[0] * 100.0
            pairs.append(Confirmed(unit, ours, 64, sumo, 16))
        return pairs

    moments, covariance = toy_moments(), np.diag(NOISE**2)
    biased = learn_discrepancy(moments, covariance, 8, confirmed(3.0))
    assert biased.predict(units[:1])[0, 0] == pytest.approx(3.0 * NOISE[0], rel=0.3)
    nothing = learn_discrepancy(moments, covariance, 8, confirmed(0.0))
    assert np.abs(nothing.predict(units) / NOISE).max() < 0.4
    assert nothing.amplitude < biased.amplitude


def test_values_are_rounded_as_results_write_them():
    values = SPACE.values_of(np.asarray([[0.123456789, 0.5, 0.9]]))
    assert values[0, 0] == 1123.46
