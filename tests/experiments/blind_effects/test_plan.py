"""What a plan holds, and what an injection does to a field."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from experiments.blind_effects.effects import EFFECTS
from experiments.blind_effects.manipulation import manipulation_check
from experiments.blind_effects.plan import CALIBRATED, LEVELS, WEIGHTS, CasePlan, draw_field, plan_cases
from experiments.blind_effects.traffic_files import arrivals_s, field_demand
from experiments.roads.road import ROADS


@pytest.mark.parametrize("road", [*ROADS, "drawn-1", "drawn-6"])
@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("level", LEVELS)
def test_every_injection_changes_the_field_and_nothing_of_its_baseline(road: str, effect: str, level: str):
    kind = "out_of_library" if EFFECTS[effect].is_outside else "single"
    drawn = draw_field(CasePlan("a", road, kind, ((effect, level),), "IDM", 12))
    plain = draw_field(CasePlan("a", road, kind, (), "IDM", 12))
    low, high = EFFECTS[effect].strengths[level]
    assert drawn.spec != drawn.without == plain.spec
    assert low <= drawn.label["effects"][0]["strength"] <= high
    assert drawn.label["theta"] == plain.label["theta"]
    shares = [one.share for one in drawn.spec.drivers if "main" in (one.entrances or ("main",))]
    assert math.isclose(sum(shares), 1.0)


def test_a_quick_plan_has_every_effect_at_every_strength():
    plans = plan_cases("quick", tuple(ROADS), 5)
    single = Counter(plan.effects[0] for plan in plans if plan.kind == "single")
    assert set(single.values()) == {1}
    assert len(single) == 3 * sum(not effect.is_outside for effect in EFFECTS.values())
    assert len({plan.name for plan in plans}) == len(plans)
    assert {plan.kind for plan in plans} == {"single", "null", "null_far", "out_of_library", "pair", "other_model"}


def test_a_plan_is_its_seed_s():
    assert plan_cases("tiny", ("corridor",), 5) == plan_cases("tiny", ("corridor",), 5)
    assert plan_cases("tiny", ("corridor",), 5) != plan_cases("tiny", ("corridor",), 6)


@pytest.mark.parametrize("seed", range(5))
def test_far_is_far_in_every_value(seed: int):
    label = draw_field(CasePlan("a", "corridor", "null_far", (), "IDM", seed)).label
    assert 0.2 <= abs(label["theta"]["tau"] / 1.1 - 1.0) <= 0.4 + 1e-4
    assert 0.075 <= abs(label["inputs"]["main"] / 3900.0 - 1.0) <= 0.15 + 1e-4


def test_only_the_kinds_that_are_asked_for_are_planned():
    every = plan_cases("quick", tuple(ROADS), 5)
    assert plan_cases("quick", tuple(ROADS), 5, ("null", "pair")) == [
        plan for plan in every if plan.kind in ("null", "pair")
    ]


def test_weights_are_drawn_over_their_ranges_and_calibrated_and_nothing_else_changes():
    plain = CasePlan("a", "corridor", "single", (("blockage", "weak"),), "IDM", 3)
    wide = [replace(plain, seed=seed, draws_weights=True) for seed in range(3, 43)]
    assert set(wide[0].calibrated) == {*CALIBRATED, *WEIGHTS}
    labels = [draw_field(plan).label for plan in wide]
    for name, (low, high) in WEIGHTS.items():
        values = np.asarray([label["theta"][name] for label in labels])
        assert low <= values.min() < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < values.max() <= high
    expected = draw_field(plain)
    assert labels[0] == expected.label | {
        "theta": expected.label["theta"] | {name: labels[0]["theta"][name] for name in WEIGHTS}
    }
    (driver,) = draw_field(wide[0]).without.drivers
    assert float(driver.attributes["lcStrategic"]) == pytest.approx(labels[0]["theta"]["lcStrategic"])


@pytest.mark.parametrize("effect", ["platooned_arrivals", "demand_surge"])
def test_mean_flow_stays(effect: str):
    road = ROADS["two_lane"]
    drawn = draw_field(CasePlan("a", "two_lane", "single", ((effect, "strong"),), "IDM", 3))
    flow = road.flows[1]
    expected = flow.share * drawn.spec.inputs_vehph["main"] * road.duration_s / 3600.0
    counts = [len(arrivals_s(drawn.spec, road, flow, np.random.default_rng(seed))) for seed in range(60)]
    assert abs(np.mean(counts) - expected) < 4.0 * np.sqrt(expected / 60)  # four standard errors of Poisson counts


def test_platoons_bunch():
    road = ROADS["corridor"]
    drawn = draw_field(CasePlan("a", "corridor", "single", (("platooned_arrivals", "strong"),), "IDM", 3))
    spread = [
        np.diff(arrivals_s(spec, road, road.flows[1], np.random.default_rng(2))).std()
        for spec in (drawn.spec, drawn.without)
    ]
    assert spread[0] > 1.1 * spread[1]


def test_demand_is_in_order_of_departure():
    drawn = draw_field(CasePlan("a", "corridor", "single", (("blockage", "weak"),), "IDM", 3))
    lines = [line for line in field_demand(drawn.spec, ROADS["corridor"], 1, 300.0).splitlines() if "depart=" in line]
    times = [float(line.split('depart="')[1].split('"')[0]) for line in lines]
    assert times == sorted(times)
    assert sum('id="ego"' in line for line in lines) == sum("<stop" in line for line in lines) == 1


def test_ramp_inflow_counts_from_the_scenario():
    drawn = draw_field(CasePlan("a", "corridor", "single", (("ramp_inflow_error", "strong"),), "IDM", 3))
    place, effect = drawn.label["place_and_time"], drawn.label["effects"][0]
    assert drawn.spec.inputs_vehph["on1"] == pytest.approx(520.0 * (1.0 + place["sign"] * effect["strength"]))


def test_manipulation_check_tells_a_change_from_seeds():
    rng = np.random.default_rng(1)
    plain = [{"a": value, "b": other} for value, other in rng.normal(size=(8, 2))]
    moved = [one | {"b": one["b"] + 6.0} for one in plain]
    check = manipulation_check(moved, plain, [True] * 8)
    assert (check["most_changed"], check["beyond_seeds"]) == ("b", True)
    assert check["standard_deviations"] == pytest.approx(6.0 / np.std([one["b"] for one in plain], ddof=1), abs=0.01)
    assert not manipulation_check(plain, plain, [False] * 8)["beyond_seeds"]


def test_what_is_but_a_lane_change_weight_is_no_effect_where_weights_are_drawn():
    def names(draws_weights: bool) -> set[str]:
        plans = plan_cases("quick", ("a",), 5, draws_weights=draws_weights)
        return {name for plan in plans for name, _ in plan.effects}

    assert names(False) - names(True) == {"keep_right", "cooperative_yielding"}
    assert "memory" in names(True)
