"""Null model, evidence, verdict and ledger on numbers whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxcalib.diagnosis.features.conventions import rounding_step
from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.atlas import ALTERED_EXACTNESS, READING_EXACTNESS, altered_exactness
from jaxcalib.diagnosis.inference.further import most_flexible_shift, next_steps
from jaxcalib.diagnosis.inference.ledger import make_ledger, parameter_shift, remaining_covariance
from jaxcalib.diagnosis.inference.left_out import differences_of
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    NONE,
    TRACE_ERROR,
    UNKNOWN,
    Explained,
    explain,
    explain_none,
    explain_unknown,
    groups_of,
    interval_90,
    log_density,
)
from jaxcalib.diagnosis.inference.pairs import judge_pairs, with_pair
from jaxcalib.diagnosis.inference.ramp_inflow import explain_ramps
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE, Verdict, judge, probabilities
from jaxcalib.diagnosis.inference.visibility import atlas_of
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from surrogate.effects.base import Reading, SearchedAt
from surrogate.effects.registry import effect_named
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null()
SIZE = len(NULL.cells)
OF_MEAN = 1.0 / 40.0  # variance of the null model's mean, in units of one drive's
BY_CHANCE = 0.7 * SIZE  # squared misfit that chance leaves
TEMPERATURE = 3.0  # what evidence between explanations is divided by here


def signature(name: str, seed: int, size: float = 1.5) -> Signature:
    """Return a signature that is linear in the strength up to 2, medium 1."""
    direction = size * np.random.default_rng(seed).standard_normal(SIZE)
    shift = np.stack([np.zeros(SIZE), direction, 2.0 * direction])
    return Signature(name, {}, np.asarray([0.0, 1.0, 2.0]), shift, np.zeros((3, SIZE)))


SIGNATURES = {name: signature(name, seed) for seed, name in enumerate(("grade", "memory", "keep_right"), 1)}


def explained(difference: np.ndarray):
    found = [explain_none(difference, NULL), explain_unknown(difference, NULL, groups_of(NULL.cells))]
    return found + [explain(difference, NULL, [one], 1.0) for one in SIGNATURES.values()]


def noise(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.linalg.cholesky(NULL.covariance) @ random.standard_normal(SIZE)


def test_noise_and_shifted_parameters_are_no_effect():
    alarms = 0
    for seed in range(60):
        found = explained(noise(seed))
        alarms += judge(found, 50.0, TEMPERATURE, 0.0, False).kind != "no_gap"
    assert alarms / 60 <= 0.1  # what is promised of nulls


@pytest.mark.parametrize("name", SIGNATURES)
def test_an_effect_is_named_with_its_strength(name: str):
    strengths = []
    for seed in range(12):
        found = explained(noise(seed) + 1.3 * SIGNATURES[name].shift[1])
        assert judge(found, 50.0, TEMPERATURE, 0.0, False).effects == (name,)
        strengths.append(next(one.strength for one in found if one.name == name))
    assert np.mean(strengths) == pytest.approx(1.3, rel=0.15)


def test_the_strength_told_is_that_of_the_place_and_direction_told():
    """Uphill here, and downhill elsewhere with much the same trace: each says the other's size with its own sign."""
    here = replace(SIGNATURES["grade"], setting={"route_from_m": 800.0})
    direction = 0.8 * here.shift + 0.6 * SIGNATURES["memory"].shift
    elsewhere = replace(here, setting={"route_from_m": 1600.0}, shift=direction, sign=-1.0)
    for seed in range(6):
        difference = noise(seed) + 1.3 * here.shift[1]
        found = explain(difference, NULL, [here, elsewhere], 1.0)
        alone = explain(difference, NULL, [here if found.setting == here.setting else elsewhere], 1.0)
        assert found.strength == pytest.approx(alone.strength)
        assert found.shift == pytest.approx(alone.shift)
        assert found.interval[0] < found.strength < found.interval[1]


def test_what_matches_no_signature_is_unknown():
    strange = 4.0 * np.random.default_rng(99).standard_normal(SIZE)
    found = explained(noise(7) + strange)
    assert judge(found, 50.0, TEMPERATURE, 0.0, False).kind == "unknown"


def test_where_a_set_of_three_says_nothing_the_answer_is_unknown():
    found = explained(noise(3) + 1.3 * SIGNATURES["grade"].shift[1])
    grade = next(one for one in found if one.name == "grade")
    twins = [replace(grade, name=f"twin {number}") for number in range(4)]
    assert judge([*found, *twins[:2]], 50.0, TEMPERATURE, 0.0, False).kind == "class"
    verdict = judge([*found, *twins], 50.0, 30.0, 0.0, False)  # nearly all as likely
    assert verdict.kind == "unknown"
    assert verdict.effects == ()
    assert sum(verdict.probability.values()) == pytest.approx(1.0)


def test_twins_are_a_set():
    found = explained(noise(3) + 1.3 * SIGNATURES["grade"].shift[1])
    twin = next(one for one in found if one.name == "grade")
    found.append(type(twin)(**{**vars(twin), "name": "local_speed_reduction"}))
    verdict = judge(found, 50.0, TEMPERATURE, 0.0, False)
    assert verdict.kind == "class"
    assert set(verdict.effects) == {"grade", "local_speed_reduction"}


def test_with_few_drives_or_one_departure_nothing_is_named_alone():
    found = explained(noise(3) + 1.3 * SIGNATURES["grade"].shift[1])
    assert judge(found, 50.0, TEMPERATURE, 0.0, False).effects == ("grade",)
    few = judge(found, 50.0, TEMPERATURE, 0.0, True)
    assert (few.kind, few.effects[0], len(few.effects)) == ("class", "grade", 2)
    aliased = judge(found, 50.0, TEMPERATURE, 0.0, False, ("grade", "keep_right"))
    assert (aliased.kind, aliased.effects) == ("class", ("grade", "keep_right"))
    assert judge(found, 50.0, TEMPERATURE, 0.0, False, ("memory", "keep_right")).kind == "effect"


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_below_the_weakest_strength_tried_a_signature_goes_on_as_it_grows_above(power: float):
    strengths = np.asarray([0.0, 0.2, 0.35])
    direction = np.random.default_rng(8).standard_normal(SIZE)
    shift = strengths[:, None] ** power * direction
    one = Signature("driver_heterogeneity", {}, strengths, shift, np.zeros_like(shift))
    assert one.exponent == pytest.approx(power)
    for strength in (0.03, 0.11, 0.2):
        np.testing.assert_allclose(one.at(strength)[0], strength**power * direction, rtol=1e-9)


@pytest.mark.parametrize("num_drives", [1, 2, 5])
def test_an_effect_is_visible_from_where_four_of_five_fields_show_it(num_drives: int):
    """An exact signature, and drives that this test makes and judges by itself, as a verdict judges the field's."""
    one = replace(signature("memory", 5, size=0.5), exactness=0.0)
    visible = atlas_of({"memory": [one]}, NULL, num_drives, OF_MEAN, {}, LEAST_EVIDENCE)["memory"].visible_from
    assert visible is not None
    medium = effect_named("memory").medium
    of_drive = NULL.noise / (1.0 / num_drives + OF_MEAN)
    random = np.random.default_rng(6)
    for strength, low, high in ((visible, 0.7, 0.9), (0.7 * visible, 0.0, 0.6)):
        shown = 0
        for _ in range(150):
            drives = random.multivariate_normal(np.zeros(SIZE), of_drive, num_drives)
            common = NULL.covariance - NULL.noise + OF_MEAN * of_drive
            drives += one.at(strength)[0] + random.multivariate_normal(np.zeros(SIZE), common)
            values = NULL.mean + drives * NULL.deviation
            tallies = DriveTallies(NULL.cells, values, np.ones_like(drives), np.zeros(num_drives))
            gains = [
                explain(field, NULL, [one], medium).log_evidence - explain_none(field, NULL).log_evidence
                for field in differences_of(tallies, NULL, OF_MEAN)
            ]
            shown += min(gains) >= LEAST_EVIDENCE
        assert low <= shown / 150 <= high


def test_what_hides_an_effect_raises_the_strength_from_which_it_is_visible():
    def visible_from(one: Signature, **more: int) -> float:
        found = atlas_of({"memory": [one]}, NULL, 8, OF_MEAN, more, LEAST_EVIDENCE)["memory"].visible_from
        return np.inf if found is None else found

    one = signature("memory", 5, size=0.4)
    exact = visible_from(replace(one, exactness=0.0))
    assert exact < visible_from(one)  # the surrogate may be wrong
    assert exact < visible_from(replace(one, exactness=0.0), memory=40)  # forty places were looked at
    # most of what was measured may be chance: errors as large as the signature itself
    assert visible_from(replace(one, error=np.abs(one.shift))) > 1.05 * visible_from(one)
    needs_more = atlas_of({"memory": [one]}, NULL, 8, OF_MEAN, {}, 3.0 * LEAST_EVIDENCE)["memory"].visible_from
    assert needs_more is None or needs_more > visible_from(one)  # chance has as much
    more = atlas_of({"memory": [one]}, NULL, 8, OF_MEAN, {}, LEAST_EVIDENCE)["memory"].visible_with_more
    assert more is not None
    assert 0.5 * visible_from(one) < more < visible_from(one)


def test_rounding_is_read_from_the_values():
    values = np.random.default_rng(2).uniform(-150.0, 150.0, 4000)
    for step in (1.0, 0.1, 0.05, 0.01):
        rounded = np.round(values / step) * step
        rounded[:200] += 0.00037  # some were moved to other instants
        assert rounding_step(rounded) == step
    assert rounding_step(values) == 0.001


def test_a_gain_that_one_drive_makes_is_no_effect():
    found = explained(noise(3) + 1.3 * SIGNATURES["grade"].shift[1])
    assert judge(found, 50.0, TEMPERATURE, 0.0, False).kind == "effect"
    assert judge(found, 1.0, TEMPERATURE, 0.0, False).kind == "no_gap"
    assert probabilities(found, 1.0, TEMPERATURE)[NONE] > 0.1


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    size=st.floats(0.0, 50.0),
    least=st.floats(-5.0, 500.0),
    temperature=st.floats(1.0, 50.0),
)
def test_probabilities_sum_to_one(seed: int, size: float, least: float, temperature: float):
    found = explained(noise(seed) + size * SIGNATURES["memory"].shift[1])
    values = probabilities(found, least, temperature)
    assert sum(values.values()) == pytest.approx(1.0, abs=1e-9)
    assert min(values.values()) >= 0.0
    assert set(values) == {NONE, UNKNOWN, *SIGNATURES}


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_ledger_adds_up(seed: int):
    values = NULL.mean + NULL.deviation * noise(seed)
    ledger = make_ledger(values, NULL, np.random.default_rng(0))
    difference = NULL.standardised(values)
    remaining = difference - NULL.slope @ parameter_shift(difference, NULL)
    whole = np.mean(remaining**2) - np.mean(np.diag(remaining_covariance(NULL)))
    assert sum(one.share for one in ledger) == pytest.approx(1.0, abs=1e-12)
    assert sum(one.excess for one in ledger) == pytest.approx(whole, abs=1e-12)
    assert all(0.0 < one.p_adjusted <= 1.0 for one in ledger)


def test_ledger_is_unbiased_and_its_p_values_hold():
    wholes, alarms = [], 0
    for seed in range(200):
        ledger = make_ledger(NULL.mean + NULL.deviation * noise(seed), NULL, np.random.default_rng(seed))
        wholes.append(sum(one.excess for one in ledger))
        alarms += min(one.p_adjusted for one in ledger) < 0.1
    assert abs(np.mean(wholes)) < 4.0 * np.std(wholes) / np.sqrt(200)
    assert alarms / 200 < 0.1 + 4.0 * np.sqrt(0.1 * 0.9 / 200)


def test_influence_has_mean_zero_and_foretells_the_change():
    random = np.random.default_rng(5)
    cells = (Cell(Channel.REPLAY, "a"), Cell(Channel.REPLAY, "b", is_logarithmic=True))
    below = random.uniform(50.0, 150.0, (30, 2))
    tallies = DriveTallies(cells, below * random.uniform(1.0, 1.2, (30, 2)), below, np.zeros(30))
    influence = tallies.influence()
    assert influence.mean(axis=0) == pytest.approx(0.0, abs=1e-12)
    without = tallies.take(np.arange(1, 30)).values()
    # leaving one of 30 out moves the pooled value by -influence/29, to first order
    assert without - tallies.values() == pytest.approx(-influence[0] / 29, rel=0.05)


def test_stages_remember(tmp_path):
    cells = (
        Cell(Channel.REPLAY, "a", from_m=0.0, to_m=200.0, locates=SearchedAt.STRETCHES, rows_per_event=20.0),
        Cell(Channel.IDENTITY, "b", role="subject", is_logarithmic=True, tolerance=0.2, reads=Reading.LATENCY),
    )
    tallies = DriveTallies(cells, np.asarray([[1.0, 2.5]]), np.asarray([[4.0, 0.0]]), np.asarray([300.0]))
    first = FinishedParts(tmp_path / "stages").tallies("part", lambda: {"x": tallies})
    again = FinishedParts(tmp_path / "stages").tallies("part", lambda: pytest.fail("made again"))
    assert again["x"].cells == first["x"].cells == cells
    assert (again["x"].above == tallies.above).all()
    next((tmp_path / "stages").iterdir()).write_bytes(b"damaged")
    assert FinishedParts(tmp_path / "stages").tallies("part", lambda: {"x": tallies})["x"].cells == cells


def test_a_ramp_far_from_its_given_inflow_is_an_error_of_inflow():
    far, near = (explain_ramps(-10.0, {1: (ratio, 0.06)}, 1.0) for ratio in (0.45, 0.97))
    assert far is not None
    assert near is not None
    assert far.log_evidence > -10.0 + 4.0
    assert near.log_evidence < -10.0
    assert far.strength == pytest.approx(-0.55, abs=0.06)
    assert explain_ramps(-10.0, {}, 1.0) is None


@pytest.mark.parametrize("truth", [-0.95, -0.85, -0.4, 0.5, 0.9, 1.5, 2.5])
def test_a_ramp_s_inflow_may_be_wrong_by_any_size(truth: float):
    found = explain_ramps(0.0, {1: (1.0 + truth, 0.05)}, 1.0)
    assert found is not None
    assert found.log_evidence > 2.5
    assert found.strength == pytest.approx(truth, abs=0.05)
    assert found.interval[0] < truth < found.interval[1]


def test_two_effects_are_found_together_and_not_in_the_errors_of_one():
    both = {name: [in_own_unit(name)] for name in SIGNATURES}

    def pairs_of(difference: np.ndarray, exactness: float = 1.0, **change):
        known = {name: [replace(one, exactness=exactness) for one in several] for name, several in both.items()}
        singles = [explain(difference, NULL, several, effect_named(name).medium) for name, several in known.items()]
        singles = [replace(one, **change) for one in sorted(singles, key=lambda one: -one.log_evidence)]
        others = [explain_unknown(difference, NULL, groups_of(NULL.cells)), explain_none(difference, NULL)]
        return judge_pairs(difference, NULL, [*singles, *others], known, {}, BY_CHANCE)

    for seed in range(4):
        pair = noise(seed + 20) + 1.5 * SIGNATURES["grade"].shift[1] + 1.3 * SIGNATURES["memory"].shift[1]
        found = pairs_of(pair)
        assert found is not None
        assert set(found.sure) == {"grade", "memory"}
        # a third thing is there that no pair explains, and neither takes away nine tenths
        elsewhere = 6.0 * np.random.default_rng(seed).standard_normal(SIZE)
        assert pairs_of(pair + elsewhere, exactness=0.1) is None
        strengths = dict(zip(found.best.names, found.best.strengths, strict=True))
        assert strengths["grade"] == pytest.approx(1.5 * effect_named("grade").medium, rel=0.35)
        assert strengths["memory"] == pytest.approx(1.3 * effect_named("memory").medium, rel=0.35)
        told = {one.name: one for one in with_pair([Explained(name, 0.0) for name in SIGNATURES], found.best)}
        for name in ("grade", "memory"):
            assert told[name].strength == strengths[name]
            assert told[name].interval[0] < told[name].strength < told[name].interval[1]
        assert told["keep_right"] == Explained("keep_right", 0.0)
    found_in_one = 0
    for seed in range(20):
        wrong = 1.0 + 0.3 * np.random.default_rng(100 + seed).standard_normal(SIZE)
        difference = noise(seed + 20) + 1.3 * wrong * SIGNATURES["grade"].shift[1]
        found_in_one += pairs_of(difference) is not None
    assert found_in_one <= 2


def test_two_effects_are_named_where_both_are_sure():
    both = explained(noise(3) + 2.0 * SIGNATURES["grade"].shift[1] + 2.0 * SIGNATURES["memory"].shift[1])
    two = judge(both, 50.0, TEMPERATURE, 0.0, False, (), ("grade", "memory"))
    assert (two.kind, two.effects) == ("pair", ("grade", "memory"))
    one = judge(both, 50.0, TEMPERATURE, 0.0, False, (), ("memory",))
    assert (one.kind, one.effects) == ("effect", ("memory",))
    for verdict in (two, one):
        assert sum(verdict.probability.values()) == pytest.approx(1.0)
    assert judge(explained(noise(4)), 50.0, TEMPERATURE, 0.0, False, (), ("grade", "memory")).kind == "no_gap"
    assert judge(both, 50.0, TEMPERATURE, 0.0, True, (), ("grade", "memory")).kind != "pair"  # too few drives
    assert judge(both, 50.0, TEMPERATURE, 0.0, False, ("grade", "blockage"), ("grade", "memory")).kind != "pair"


def in_own_unit(name: str) -> Signature:
    """Return a signature whose medium strength is that of the effect library."""
    one = SIGNATURES[name]
    return replace(one, strengths=one.strengths * effect_named(name).medium)


def test_all_effects_at_once_explain_at_least_what_one_does():
    difference = noise(5) + 1.5 * SIGNATURES["keep_right"].shift[1] - 1.0 * SIGNATURES["memory"].shift[1]
    shift = most_flexible_shift(difference, NULL, {name: [in_own_unit(name)] for name in SIGNATURES})
    before = log_density(difference, NULL.covariance)[1]
    alone = min(log_density(difference - 1.5 * one.shift[1], NULL.covariance)[1] for one in SIGNATURES.values())
    assert log_density(difference - shift, NULL.covariance)[1] < min(before, alone)
    np.testing.assert_array_equal(most_flexible_shift(difference, NULL, {}), 0.0)


@pytest.mark.parametrize("kind", ["no_gap", "miscalibrated", "effect", "pair", "class", "unknown"])
def test_there_is_always_something_to_try_next(kind: str):
    effects = {"effect": ("grade",), "pair": ("grade", "memory"), "class": ("grade", "memory")}.get(kind, ())
    lines = next_steps(
        Verdict(kind, effects, {}, ""), {"grade": ["local_speed_reduction"]}, ["speed (200 to 400 m)", "gap"],
        {"grade": 0.01, "memory": None}, {"grade": None, "memory": None},
    )  # fmt: skip
    assert lines
    assert all(line.endswith(".") and "_" not in line for line in lines)


def test_a_feature_that_reads_a_strength_from_the_log_tells_it():
    """Traffic may answer by a quarter less than a signature says; what reads the strength itself does not."""
    one = signature("gap_sensor_bias", 9, size=8.0)
    one.shift[:, 3] = [0.0, 25.0, 50.0]
    field = 0.75 * one.at(1.4)[0]
    field[3] = one.at(1.4)[0][3]
    is_reading = np.arange(SIZE) == 3
    cells = tuple(cell._replace(channel=Channel.IDENTITY) if k == 3 else cell for k, cell in enumerate(NULL.cells))
    told = {}
    for name, exactness in (("alike", 0.4), ("reading", np.where(is_reading, 0.02, 0.4))):
        told[name] = explain(field, replace(NULL, cells=cells), [replace(one, exactness=exactness)], 1.0).strength
    assert abs(told["reading"] - 1.4) < 0.5 * abs(told["alike"] - 1.4)


def test_readings_are_nearly_exact():
    cells = (Cell(Channel.IDENTITY, "any"), Cell(Channel.IDENTITY, "other", reads=Reading.DISTANCE_SCALE))
    np.testing.assert_allclose(altered_exactness("gap_sensor_bias", cells), [ALTERED_EXACTNESS, READING_EXACTNESS])
    np.testing.assert_allclose(altered_exactness("sensor_noise", cells), ALTERED_EXACTNESS)


def test_an_interval_reaches_halfway_to_the_next_strength_and_as_far_as_traces_differ():
    strengths, sure = np.asarray([0.25, 0.5, 1.0, 1.5, 2.0]), np.asarray([0.0, 0.0, 1.0, 0.0, 0.0])
    assert interval_90(strengths, sure, 0.0) == pytest.approx((0.75, 1.25))
    low, high = interval_90(strengths, sure, 0.5)
    assert 0.75 / low == pytest.approx(high / 1.25)
    assert high / 1.25 == pytest.approx(1.0 + 1.6449 * 0.5 * TRACE_ERROR, rel=1e-3)
    negative = interval_90(-strengths, sure, 0.5)
    assert negative == pytest.approx((-high, -low))
    spread = interval_90(strengths, np.asarray([0.2, 0.2, 0.2, 0.2, 0.2]), 0.0)
    assert spread == pytest.approx((0.125, 2.125))


def test_a_rhythm_in_a_pair_is_told_as_it_beats():
    """Half of the drivers act every 0.9 s: the trace is that rhythm's, weaker, and the strength is the rhythm's own."""
    beat = [
        replace(signature("reaction_delay", seed, 4.0), is_fixed=True, strengths=np.asarray([0.0, 0.5, 1.0]) * seconds)
        for seed, seconds in ((11, 0.9), (12, 1.2))
    ]
    both = {"reaction_delay": beat, "memory": [in_own_unit("memory")]}
    difference = noise(4) + 0.6 * beat[0].shift[2] + 2.0 * SIGNATURES["memory"].shift[1]
    singles = [explain(difference, NULL, several, effect_named(name).medium) for name, several in both.items()]
    singles = sorted(singles, key=lambda one: -one.log_evidence)
    found = judge_pairs(difference, NULL, [*singles, explain_none(difference, NULL)], both, {}, BY_CHANCE)
    assert found is not None
    told = dict(zip(found.best.names, zip(found.best.strengths, found.best.intervals, strict=True), strict=True))
    strength, (low, high) = told["reaction_delay"]
    assert strength == pytest.approx(0.9, abs=0.02)
    assert low <= strength <= high
