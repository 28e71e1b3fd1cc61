"""What the logs of the small case say before any traffic is simulated: its planted drivers, and its inflows."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.roads.road import BELIEVED_DRIVER
from experiments.small_case import RAMP, TRUE_INPUTS_VEHPH, TRUTH
from jaxcalib.initial_values.demand_profile import (
    BENT_SHARE,
    COMMON_TRUST,
    SCENARIO_TRUST,
    DemandEstimate,
    SectionVolumes,
    estimate_demand,
)
from jaxcalib.initial_values.driver_values import usual_length_m
from jaxcalib.initial_values.fitted_pairs import is_believed, steps_between_moments
from jaxcalib.initial_values.initial_point import InitialPoint, find_initial_point, without_driver_logs
from jaxcalib.problem.problem import CalibrationProblem

DRIVER = BELIEVED_DRIVER | {name: str(value) for name, value in TRUTH.items()}


@pytest.fixture(scope="module")
def initial(small_problem: CalibrationProblem) -> InitialPoint:
    return find_initial_point(small_problem, 0.5, {}, seed=1)


@pytest.mark.long
def test_the_field_s_drivers_are_found_within_their_errors(initial: InitialPoint) -> None:
    space, names = initial.space, initial.space.names
    truth = initial.scenario_values.copy()
    for name in ("tau", "minGap", "accel", "decel", "speedFactor"):
        truth[names.index(name)] = float(DRIVER[name])
    off = space.unit_of(initial.values) - space.unit_of(truth)
    for name in ("tau", "minGap", "accel", "decel", "speedFactor"):
        place = names.index(name)
        assert abs(off[place]) < 3.0 * initial.unit_error[place] < 0.2
        assert "pairs" in initial.source[place]
    assert initial.values[names.index("tau")] == pytest.approx(TRUTH["tau"], rel=0.03)
    assert initial.values[names.index("speedFactor")] == pytest.approx(TRUTH["speedFactor"], rel=0.04)


@pytest.mark.long
def test_the_field_s_inflow_is_found_within_its_error(initial: InitialPoint) -> None:
    found, error = initial.demand.values_vehph, initial.demand.error_vehph
    for place, (name, truth) in enumerate(TRUE_INPUTS_VEHPH.items()):
        assert initial.space.names[place] == name
        assert abs(found[place] - truth) < 3.0 * error[place]


@pytest.mark.long
def test_without_the_logs_drivers_are_the_scenario_s(initial: InitialPoint) -> None:
    silent = without_driver_logs(initial)
    np.testing.assert_allclose(silent.values[2:], initial.scenario_values[2:], rtol=1e-5)
    np.testing.assert_array_equal(silent.values[:2], initial.values[:2])
    assert np.isinf(silent.unit_error[2:]).all()
    assert set(silent.source[2:]) == {"scenario"}
    assert silent.drivers.replay_loss is None


def section_volumes(problem: CalibrationProblem, main_vehph: float, ramp_vehph: float) -> np.ndarray:
    """Return the volume on each section: the ramp's vehicles pass what lies behind the merge."""
    border = np.asarray(problem.road.section_border_m, float)
    merge_m = problem.scenario.network.edge_start_m(RAMP[2])
    passed = np.clip((border[1:] - np.maximum(border[:-1], merge_m)) / np.diff(border), 0.0, 1.0)
    assert passed[0] == 0.0
    assert passed[-1] > 0.95
    return main_vehph + ramp_vehph * passed


def estimated(
    problem: CalibrationProblem,
    volume: np.ndarray,
    error: np.ndarray,
    in_scenario: SectionVolumes | None = None,
) -> DemandEstimate:
    field = SectionVolumes(volume, error)
    return estimate_demand(problem.scenario, problem.template, problem.road, field, in_scenario)


def test_inflows_are_found_from_volumes_along_the_route(small_problem: CalibrationProblem) -> None:
    volume = section_volumes(small_problem, 2000.0, 600.0)
    found = estimated(small_problem, volume, np.full(len(volume), 2.0))
    # errors of 2 veh/h outweigh what the scenario says by a hundred
    np.testing.assert_allclose(found.values_vehph, [2000.0, 600.0], rtol=0.005)
    assert (found.error_vehph < 10.0).all()


def test_what_is_not_seen_stays_the_scenario_s_with_its_own_error(small_problem: CalibrationProblem) -> None:
    nothing = np.full(small_problem.road.num_sections, np.nan)
    found = estimated(small_problem, nothing, nothing)
    np.testing.assert_allclose(found.values_vehph, found.scenario_vehph)
    trust = np.hypot(COMMON_TRUST, SCENARIO_TRUST)
    np.testing.assert_allclose(found.error_vehph, trust * found.scenario_vehph, rtol=1e-9)
    np.testing.assert_allclose(found.scenario_vehph, [2700.0, 420.0], rtol=1e-4)


def test_one_section_moves_all_inflows_by_a_common_factor_first(small_problem: CalibrationProblem) -> None:
    """Before the merge only the main road is seen; the ramp follows by the share of the common factor's variance."""
    volume = section_volumes(small_problem, 2000.0, 600.0)
    first_only = np.where(np.arange(len(volume)) == 0, volume, np.nan)
    error = np.where(np.isfinite(first_only), 1.0, np.nan)
    scenario = small_problem.template.base_demand_vehph()
    found = estimated(small_problem, first_only, error)
    change = found.values_vehph / scenario - 1.0
    assert change[0] == pytest.approx(2000.0 / 2700.0 - 1.0, abs=0.002)
    # regression of one inflow's departure on the other's, of which only the common factor is the same
    common = COMMON_TRUST**2 / (COMMON_TRUST**2 + found.trust[0] ** 2)
    assert change[1] == pytest.approx(common * change[0], rel=1e-3)
    left = np.sqrt((1.0 - common) * COMMON_TRUST**2 + found.trust[1] ** 2)
    assert found.error_vehph[1] == pytest.approx(left * scenario[1], rel=1e-3)


def test_a_count_that_is_far_off_does_not_make_the_others_pay(small_problem: CalibrationProblem) -> None:
    """The ramp has two fifths of what the scenario says; volumes are good to 1 % of the main road's inflow."""
    volume = section_volumes(small_problem, 2700.0, 0.4 * 420.0)
    found = estimated(small_problem, volume, np.full(len(volume), 25.0))
    assert found.trust[1] > 1.3 * SCENARIO_TRUST
    assert found.values_vehph[0] == pytest.approx(2700.0, rel=0.03)
    assert found.values_vehph[1] == pytest.approx(0.4 * 420.0, rel=0.35)


def test_what_drives_see_of_a_known_demand_is_no_demand(small_problem: CalibrationProblem) -> None:
    """A drive counts itself and those it gathers: what it sees too much of one road it sees too much of the other."""
    error = np.full(small_problem.road.num_sections, 2.0)
    gathered_vehph = np.linspace(300.0, 900.0, len(error))
    in_scenario = SectionVolumes(section_volumes(small_problem, 2700.0, 420.0) + gathered_vehph, error)
    volume = section_volumes(small_problem, 2500.0, 480.0) + gathered_vehph
    found = estimated(small_problem, volume, error, in_scenario)
    np.testing.assert_allclose(found.values_vehph, [2500.0, 480.0], rtol=0.005)
    believed = estimated(small_problem, volume, error)
    assert (np.abs(believed.values_vehph - [2500.0, 480.0]) > 100.0).any()


def test_what_comes_while_nobody_drives_is_not_in_the_volumes(small_problem: CalibrationProblem) -> None:
    """The ramp's vehicles come until 100 s: during 40 and 8 of the 80 s of each drive."""
    scenario = small_problem.scenario
    flows = tuple(replace(flow, end_s=100.0) if flow.route[0] == RAMP[0] else flow for flow in scenario.flows)
    assert flows != scenario.flows
    problem = replace(small_problem, scenario=replace(scenario, flows=flows))
    volume = section_volumes(problem, 2000.0, 0.3 * 600.0)
    field, observed_s = SectionVolumes(volume, np.full(len(volume), 1.0)), [(60.0, 140.0), (92.0, 172.0)]
    found = estimate_demand(problem.scenario, problem.template, problem.road, field, None, observed_s)
    np.testing.assert_allclose(found.values_vehph, [2000.0, 600.0], rtol=0.01)


def test_drives_that_see_a_part_of_the_demand_see_that_part_of_its_change(small_problem: CalibrationProblem) -> None:
    error = np.full(small_problem.road.num_sections, 2.0)
    scenario = section_volumes(small_problem, 2700.0, 420.0)
    in_scenario, volume = SectionVolumes(0.6 * scenario, error), 0.6 * 1.1 * scenario
    found = estimated(small_problem, volume, error, in_scenario)
    np.testing.assert_allclose(found.values_vehph, 1.1 * found.scenario_vehph, rtol=0.003)
    # a drive that need not answer in proportion leaves a share of the change uncertain
    assert (found.error_vehph > 0.99 * BENT_SHARE * 0.1 * found.scenario_vehph).all()


def test_the_scenario_itself_is_found_where_the_field_is_the_scenario(small_problem: CalibrationProblem) -> None:
    error = np.full(small_problem.road.num_sections, 50.0)
    volume = 0.7 * section_volumes(small_problem, 2700.0, 420.0) + 250.0
    found = estimated(small_problem, volume, error, SectionVolumes(volume, error))
    np.testing.assert_allclose(found.values_vehph, found.scenario_vehph, rtol=1e-9)


@pytest.mark.parametrize(
    ("numbers", "step_s", "num_steps"),
    [
        ({"sigma": 0.0, "accel": 2.6}, 0.1, 1),
        ({"accel": 1.3}, 0.1, 1),  # IDM has no sigma
        ({"sigma": 0.5, "accel": 2.6}, 0.1, 23),  # 0.375 m/s² of a step are 0.08 of the mean of 22.005
        ({"sigma": 0.5, "accel": 2.6}, 0.5, 8),  # at most four seconds
        ({"sigma": 0.1, "accel": 2.6}, 1.0, 1),
        ({"sigma": 1.0, "accel": 5.0}, 4.5, 1),
    ],
)
def test_dawdling_drivers_are_looked_at_over_as_many_steps_as_average_it_out(
    numbers: dict[str, float], step_s: float, num_steps: int
) -> None:
    assert steps_between_moments(numbers, step_s) == num_steps


@pytest.mark.parametrize(
    ("values", "explained_share", "believed"),
    [
        ([1.2, 2.2, 0.0, 1.9], 0.8, True),  # 0 is an ordinary value of sigma
        ([1.2, 6.0, 0.4, 1.9], 0.8, True),
        ([1.2, 6.0, 0.4, 0.3], 0.8, False),
        ([1.2, 2.2, 0.4, 1.9], 0.2, False),
    ],
)
def test_a_fit_that_ends_at_the_bounds_is_not_believed(values: list[float], explained_share: float, believed: bool):
    lower, upper = np.asarray([0.4, 0.5, 0.0, 0.3]), np.asarray([3.0, 6.0, 1.0, 5.0])
    fit = SimpleNamespace(values=np.asarray(values), explained_share=explained_share)
    assert is_believed(fit, lower, upper, 1) == believed  # pyright: ignore[reportArgumentType]


def test_drives_simulated_at_another_known_demand_tell_the_same_inflows(small_problem: CalibrationProblem) -> None:
    """Nothing of where the simulation was made is left but the error of what may not answer in proportion."""
    problem, at_vehph = small_problem, np.asarray([2050.0, 590.0])
    error = np.full(problem.road.num_sections, 2.0)
    gathered_vehph = np.linspace(300.0, 900.0, len(error))
    simulated = SectionVolumes(section_volumes(problem, *at_vehph) + gathered_vehph, error)
    field = SectionVolumes(section_volumes(problem, 2000.0, 600.0) + gathered_vehph, error)
    found = estimate_demand(problem.scenario, problem.template, problem.road, field, simulated, (), at_vehph)
    np.testing.assert_allclose(found.values_vehph, [2000.0, 600.0], rtol=0.005)
    far = estimated(
        problem, field.vehph, error, SectionVolumes(section_volumes(problem, 2700.0, 420.0) + gathered_vehph, error)
    )
    assert (found.error_vehph < 0.5 * far.error_vehph).all()


def test_drives_are_simulated_again_until_the_demand_settles(small_problem: CalibrationProblem) -> None:
    """Drives that see the root of the demand: one comparison, which takes them to answer in proportion, falls short."""
    field = small_problem.field_of("fit")
    index = [small_problem.tally_index[f"section_speed[{s}]"] for s in range(small_problem.road.num_sections)]
    scenario_vehph = small_problem.template.base_demand_vehph()
    true_factor, asked_vehph = 0.6, []

    def simulated(values: np.ndarray) -> np.ndarray:
        asked_vehph.append(values[:2])
        tallies = field.copy()
        tallies[:, index] *= np.sqrt(values[0] / scenario_vehph[0] / true_factor)
        return tallies

    found = find_initial_point(small_problem, 0.2, {}, 0, simulated)
    assert 1 < len(asked_vehph) <= 3
    np.testing.assert_allclose(asked_vehph[0], scenario_vehph, rtol=1e-5)
    errors = [abs(values[0] / scenario_vehph[0] - true_factor) for values in (*asked_vehph, found.values)]
    assert errors[-1] < 0.5 * errors[1] < 0.25 * errors[0]


def test_inflows_are_searched_as_far_as_their_error_reaches(small_problem: CalibrationProblem) -> None:
    certain = find_initial_point(small_problem, 0.2, {}, 0)
    known = {"main": (100.0, 200.0)}
    reach = (certain.space.upper[:2] - certain.values[:2]) / certain.values[:2]
    error = certain.unit_error[:2] * (certain.space.upper - certain.space.lower)[:2] / certain.values[:2]
    np.testing.assert_allclose(reach, np.maximum(0.2, 3.0 * error), rtol=1e-3)
    asked = find_initial_point(small_problem, 0.2, known, 0)
    assert (asked.space.lower[0], asked.space.upper[0]) == known["main"]


def test_more_demand_is_not_believed_where_it_makes_the_volumes_less_alike(small_problem: CalibrationProblem) -> None:
    """A simulation that jams: the more come, the fewer get through, and what is missing asks for still more."""
    field = small_problem.field_of("fit")
    index = [small_problem.tally_index[f"section_speed[{s}]"] for s in range(small_problem.road.num_sections)]
    scenario_vehph = small_problem.template.base_demand_vehph()
    asked_vehph = []

    def simulated(values: np.ndarray) -> np.ndarray:
        asked_vehph.append(values[:2])
        tallies = field.copy()
        tallies[:, index] *= 0.85 * (scenario_vehph[0] / values[0]) ** 2
        return tallies

    found = find_initial_point(small_problem, 0.2, {}, 0, simulated)
    assert len(asked_vehph) == 2
    np.testing.assert_allclose(found.values[:2], 0.5 * (asked_vehph[0] + asked_vehph[1]), rtol=0.01)
    assert (found.demand.error_vehph >= 0.49 * np.abs(asked_vehph[1] - asked_vehph[0])).all()


def test_the_usual_length_is_that_of_most_vehicles() -> None:
    lengths_m = {"car": 5.0, "van": 6.5, "truck": 12.0}

    def flow(vtype: str, rate_vehps: float, end_s: float = 600.0) -> SimpleNamespace:
        return SimpleNamespace(vtype=vtype, rate_vehps=rate_vehps, begin_s=0.0, end_s=end_s)

    def usual_m(*flows: SimpleNamespace) -> float:
        scenario = SimpleNamespace(flows=flows, end_s=600.0, values_of=lambda vtype: {"length": lengths_m[vtype]})
        return usual_length_m(cast(Any, scenario))

    assert usual_m(flow("truck", 0.2), flow("car", 0.3), flow("van", 0.05)) == 5.0
    assert usual_m(flow("truck", 0.2, 1e6), flow("car", 0.3)) == 5.0  # what comes after the end does not count
    assert usual_m(flow("truck", 0.2), flow("car", 0.1)) == 12.0
