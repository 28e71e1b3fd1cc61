"""An explanation fitted once more around runs that contain it, on made-up drives whose effect is not linear."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import Window, window_of
from jaxcalib.diagnosis.inference.atlas import Slopes
from jaxcalib.diagnosis.inference.investigation import Prepared
from jaxcalib.diagnosis.inference.ledger import parameter_shift
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained, explain
from jaxcalib.diagnosis.inference.refit import refit
from jaxcalib.diagnosis.inference.refitted_contest import (
    MOST_LEFT,
    contenders,
    is_enough_alone,
    with_refits,
    without_poor_fits,
)
from jaxcalib.diagnosis.inference.sumo_check import CHECKED_EXACTNESS
from jaxcalib.diagnosis.inference.verdict import Verdict
from jaxcalib.diagnosis.runs.explained_runs import ExplainedRuns, moved_values
from jaxcalib.statistics.normal import HALF_WIDTH_90
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null(num_features=60)
SIZE = len(NULL.cells)
DIRECTION = 6.0 * np.random.default_rng(1).standard_normal(SIZE)
BEND = 1.5 * np.random.default_rng(2).standard_normal(SIZE)
STEPS = np.asarray([0.8, -1.1, 0.4])
STRENGTHS = np.asarray([0.0, 0.5, 0.8])  # memory: medium and strong
TRUE_STRENGTH = 0.75
NUM_RUNS = 300


def truth(steps: np.ndarray, strength: float) -> np.ndarray:
    """Return what parameters and effect do: the effect grows faster than its strength, and weakens with a parameter."""
    return NULL.slope @ steps + strength * (1.0 - 0.15 * steps[0]) * DIRECTION + strength**2 * BEND


def tallies(shift: np.ndarray, num_runs: int = NUM_RUNS, seed: int = 3) -> DriveTallies:
    spread = np.sqrt(8.0) * np.random.default_rng(seed).standard_normal((num_runs, SIZE))
    above = NULL.mean + NULL.deviation * (shift + spread)
    return DriveTallies(NULL.cells, above, np.ones_like(above), np.zeros(num_runs))


def drives(strength: float) -> Prepared:
    difference = truth(STEPS, strength) + 0.5 * np.linalg.cholesky(NULL.noise) @ np.random.default_rng(
        5
    ).standard_normal(SIZE)
    empty = np.zeros((SIZE, len(STEPS)))
    return Prepared(tallies(difference, 8), NULL, difference, Slopes(empty, empty, np.zeros((0, SIZE))), np.zeros(SIZE))


def signature(is_fixed: bool = False, sign: float = 1.0) -> Signature:
    shift = np.stack([truth(np.zeros(3), one) for one in STRENGTHS])
    return Signature("memory", {}, STRENGTHS, shift, np.zeros_like(shift), sign=sign, is_fixed=is_fixed)


class Made:
    """Makes runs with the truth; the surrogate's are bent otherwise by so much, and seen beside its own baseline."""

    def __init__(self, bend: float = 0.0, fails: bool = False, in_sumo: bool = True, sensor: bool = False) -> None:
        self.bend, self.fails, self.has_sumo, self.is_sensor = bend, fails, in_sumo, sensor
        self.asked: list[str] = []

    def features(self, steps: np.ndarray, strength: float) -> np.ndarray:
        return truth(steps, strength) + self.bend * strength**2 * BEND

    def in_surrogate(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        self.asked.append("surrogate")
        if self.fails or self.is_sensor:
            return None
        bias = 2.0 * DIRECTION
        return ExplainedRuns(tallies(self.features(steps, strength) + bias, seed=7), tallies(bias, seed=7))

    def in_sumo(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        self.asked.append("sumo")
        if self.fails or not self.has_sumo:
            return None
        return ExplainedRuns(tallies(self.features(steps, strength), seed=8))

    def slopes(self, signature: Signature, steps: np.ndarray, strength: float, known: np.ndarray) -> np.ndarray:
        assert known.shape == (SIZE, len(steps) + 1)
        sides = []
        for step in 0.01 * np.eye(len(steps) + 1):
            up, down = (self.features(steps + s * step[:-1], strength + s * step[-1]) for s in (1.0, -1.0))
            sides.append((up - down) / 0.02)
        return np.stack(sides, axis=1)


def test_strength_and_parameters_come_nearer_to_the_truth():
    prepared = drives(TRUE_STRENGTH)
    best = explain(prepared.difference, NULL, [signature()], 0.5)
    found = refit(prepared, best, [signature()], Made())
    assert found is not None
    assert abs(found.strength - TRUE_STRENGTH) < 0.5 * abs(best.strength - TRUE_STRENGTH)
    assert found.interval_90[0] < TRUE_STRENGTH < found.interval_90[1]
    np.testing.assert_allclose(found.steps, STEPS, atol=0.6)
    assert best.shift is not None
    wanted = truth(STEPS, TRUE_STRENGTH)
    linear = best.shift + NULL.slope @ parameter_shift(prepared.difference - best.shift, NULL)
    assert np.mean((found.expected(NULL, NULL) - wanted) ** 2) < 0.5 * np.mean((linear - wanted) ** 2)
    assert found.num_sumo_runs in (NUM_RUNS, 2 * NUM_RUNS)
    assert found.runs.without is None


def test_the_interval_holds_by_how_far_simulators_disagree():
    """A surrogate in which the effect does less asks for more of it; half of the time the road does, too."""
    prepared = drives(TRUE_STRENGTH)
    best = explain(prepared.difference, NULL, [signature()], 0.5)

    class Weaker(Made):
        def in_surrogate(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
            return super().in_surrogate(signature, steps, 0.8 * strength)

    alike, differ = (refit(prepared, best, [signature()], maker) for maker in (Made(), Weaker()))
    assert alike is not None
    assert differ is not None
    assert differ.strength == pytest.approx(alike.strength, abs=0.03)  # SUMO's
    narrow, wide = (one.strength - one.interval_90[0] for one in (alike, differ))
    disagreement = (1.0 / 0.8 - 1.0) * TRUE_STRENGTH
    assert wide == pytest.approx(np.hypot(narrow, HALF_WIDTH_90 * disagreement / np.sqrt(2.0)), rel=0.3)


@pytest.mark.parametrize("maker", [Made(in_sumo=False), Made(sensor=True)], ids=["surrogate alone", "sensor"])
def test_one_simulator_is_enough(maker: Made):
    prepared = drives(TRUE_STRENGTH)
    best = explain(prepared.difference, NULL, [signature()], 0.5)
    found = refit(prepared, best, [signature()], maker)
    assert found is not None
    assert found.strength == pytest.approx(TRUE_STRENGTH, abs=0.06)
    np.testing.assert_allclose(found.steps, STEPS, atol=0.6)
    assert (found.num_sumo_runs > 0) == maker.is_sensor


def test_where_steps_do_not_lead_to_an_agreement_they_begin_again_at_what_fits_with_another_explanation():
    """Values so far off that the steps' slopes point the wrong way."""
    prepared, maker = drives(TRUE_STRENGTH), Made(in_sumo=False)
    far = np.asarray([6.0, 0.0, 0.0])
    moved = replace(prepared, difference=prepared.difference + NULL.slope @ far)
    best = explain(prepared.difference, NULL, [signature()], 0.5)
    straight = maker.features

    def folded(steps: np.ndarray, strength: float) -> np.ndarray:
        """Return features that answer to the first parameter only near where the drives were made."""
        return straight(np.where(np.abs(steps - STEPS - far) < 2.0, steps, np.asarray([-2.0, *steps[1:]])), strength)

    maker.features = folded
    alone = refit(moved, best, [signature()], maker)
    beside = refit(moved, best, [signature()], maker, known_steps=STEPS + far)
    assert alone is not None
    assert beside is not None
    assert beside.misfit < 0.7 * alone.misfit
    np.testing.assert_allclose(beside.steps, STEPS + far, atol=1.0)


def test_features_that_runs_do_not_show_come_from_the_signature():
    prepared = drives(TRUE_STRENGTH)
    best = explain(prepared.difference, NULL, [signature()], 0.5)
    maker, hidden = Made(in_sumo=False), np.arange(SIZE) % 6 == 1
    shown = maker.in_surrogate

    def blind(signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        made = shown(signature, steps, strength)
        assert made is not None
        assert made.without is not None
        with_effect, without = (replace(one, below=one.below * ~hidden, above=one.above * ~hidden)
                                for one in (made.with_effect, made.without))  # fmt: skip
        return ExplainedRuns(with_effect, without)

    maker.in_surrogate = blind
    found = refit(prepared, best, [signature()], maker)
    assert found is not None
    runs, _ = found.runs.difference(NULL)
    np.testing.assert_allclose(runs[hidden], 0.0)
    expected = signature().at(found.strength)[0]
    np.testing.assert_allclose(found.correction[hidden], expected[hidden], atol=1.0)


def test_only_the_fitted_explanation_changes():
    prepared = drives(TRUE_STRENGTH)
    best = explain(prepared.difference, NULL, [signature(sign=-1.0)], 0.5)
    other = Explained("none", -1000.0)
    found = refit(prepared, best, [signature(sign=-1.0)], Made())
    assert found is not None
    one, same = with_refits([best, other], {"memory": found})
    assert same is other
    assert one.strength == -found.strength
    assert one.interval[0] <= one.strength <= one.interval[1]
    readings = (*best.interval, *(-size for size in found.interval_90))
    assert one.interval == (min(readings), max(readings))
    assert one.log_evidence == best.log_evidence
    assert with_refits([best], {}) == [best]


def test_refits_tell_apart_what_signatures_do_not():
    """Two effects with one signature; only one of them bends as the drives do."""
    prepared = drives(TRUE_STRENGTH)
    right = explain(prepared.difference, NULL, [signature()], 0.5)
    wrong = replace(right, name="platooned_arrivals", log_evidence=right.log_evidence + 3.0)
    none = Explained("none", right.log_evidence - 50.0)
    far = replace(right, name="keep_right", log_evidence=right.log_evidence - 40.0)
    signatures = {name: [signature()] for name in ("memory", "platooned_arrivals", "keep_right")}
    all_of_them = [wrong, right, far, none]
    asked = contenders(all_of_them, signatures, Verdict("class", ("memory", "platooned_arrivals"), {}, ""))
    assert [one.name for one in asked] == ["platooned_arrivals", "memory"]
    assert contenders(all_of_them, signatures, Verdict("unknown", (), {}, "")) == [wrong]
    alone = Verdict("effect", ("platooned_arrivals",), {}, "")
    assert contenders(all_of_them, signatures, alone) == [wrong]  # the surrogate's word for each of them
    in_sumo = replace(signature(), exactness=CHECKED_EXACTNESS)
    assert contenders(all_of_them, signatures | {"keep_right": [in_sumo]}, alone) == [wrong, far]
    shown = {"platooned_arrivals": [in_sumo], "keep_right": [in_sumo]}
    assert contenders(all_of_them, signatures | shown, alone) == [wrong]
    assert contenders(all_of_them, signatures, Verdict("pair", ("keep_right", "memory"), {}, "")) == [right]

    refits = {}
    for one, maker in zip(asked, (Made(bend=4.0), Made()), strict=True):
        found = refit(prepared, one, signatures[one.name], maker)
        assert found is not None
        refits[one.name] = found
    judged = with_refits([wrong, right, far, none], refits)
    evidence = {one.name: one.log_evidence for one in judged}
    assert judged[0].name == "memory"
    assert evidence["memory"] == wrong.log_evidence
    behind = refits["memory"].log_evidence - refits["platooned_arrivals"].log_evidence
    assert behind > 20.0
    assert evidence["memory"] - evidence["platooned_arrivals"] == pytest.approx(behind)
    assert far in judged
    assert none in judged


def test_one_effect_that_leaves_no_more_than_a_right_one_needs_no_second_one():
    found = refit(drives(TRUE_STRENGTH), explain(drives(TRUE_STRENGTH).difference, NULL, [signature()], 0.5),
                  [signature()], Made())  # fmt: skip
    assert found is not None
    poor, good = replace(found, misfit=1.1 * MOST_LEFT * 40.0), replace(found, misfit=0.9 * MOST_LEFT * 40.0)
    assert is_enough_alone({"memory": good}, by_chance=40.0)
    assert not is_enough_alone({"memory": poor}, by_chance=40.0)
    assert not is_enough_alone({}, by_chance=40.0)


def test_what_leaves_too_much_though_it_was_fitted_again_is_not_named():
    found = refit(drives(TRUE_STRENGTH), explain(drives(TRUE_STRENGTH).difference, NULL, [signature()], 0.5),
                  [signature()], Made())  # fmt: skip
    assert found is not None
    shares = {"memory": 0.6, "keep_right": 0.3, "grade": 0.05, "unknown": 0.05, "none": 0.0}
    both = Verdict("class", ("memory", "keep_right"), shares, "")
    poor, good = replace(found, misfit=1.1 * MOST_LEFT * 40.0), replace(found, misfit=0.9 * MOST_LEFT * 40.0)

    assert without_poor_fits(both, {"memory": good}, 40.0) is both
    other = without_poor_fits(both, {"memory": good, "keep_right": poor}, 40.0)
    assert (other.kind, other.effects) == ("effect", ("memory",))
    assert "One effect" in other.reason
    # where these drives cannot tell it from others, what is named with it stays
    refits = {"memory": good, "keep_right": poor}
    assert without_poor_fits(both, refits, 40.0, never_alone=("memory", "keep_right")) is both
    assert without_poor_fits(both, refits, 40.0, never_alone=("keep_right",)).kind == "effect"
    assert other.probability == {"memory": 0.6, "keep_right": 0.0, "grade": 0.05, "unknown": 0.35, "none": 0.0}
    # what is left of a set need not be likely
    assert without_poor_fits(both, {"memory": poor, "keep_right": good}, 40.0).kind == "unknown"
    nothing = without_poor_fits(replace(both, kind="effect", effects=("memory",)), {"memory": poor}, 40.0)
    assert (nothing.kind, nothing.effects) == ("unknown", ())
    assert "memory, leaves 2.2 times" in nothing.reason
    assert max(nothing.probability, key=nothing.probability.__getitem__) == "unknown"


def test_a_signature_that_holds_at_its_own_strength_keeps_it():
    prepared = drives(0.8)
    fixed = signature(is_fixed=True)
    best = explain(prepared.difference, NULL, [fixed], 0.5)
    found = refit(prepared, best, [fixed], Made())
    assert found is not None
    assert found.strength == pytest.approx(best.strength)
    low, high = found.interval_90  # only one strength was tried: a quarter of it on either side
    assert (low, high) == pytest.approx((0.75 * best.strength, 1.25 * best.strength))


def test_runs_that_fail_leave_the_contest_s_word():
    prepared = drives(TRUE_STRENGTH)
    best = explain(prepared.difference, NULL, [signature()], 0.5)
    assert refit(prepared, best, [signature()], Made(fails=True)) is None


def test_a_surrogate_s_runs_count_by_their_difference():
    biased, shift = 2.0 * np.random.default_rng(9).standard_normal(SIZE), truth(STEPS, 0.3)
    runs = ExplainedRuns(tallies(biased + shift, seed=4), tallies(biased, seed=4))
    found, _ = runs.difference(NULL)
    np.testing.assert_allclose(found, shift, atol=1e-9)


def test_values_never_fall_to_nothing():
    values, sizes = np.asarray([900.0, 0.4]), np.asarray([90.0, 0.1])
    np.testing.assert_allclose(moved_values(values, sizes, np.asarray([1.5, -9.0])), [1035.0, 0.12])


def test_a_window_survives_its_signature():
    window = Window(900.0, 1300.0, 200.0, 320.0, 2, -1.0)
    of_it = Signature("grade", window.setting(), STRENGTHS, np.zeros((3, 2)), np.zeros((3, 2)), sign=-1.0)
    assert window_of(of_it) == window
    assert window_of(signature()) is None
    told = window.effect_setting(-0.02)
    assert (told.strength, told.route_from_m, told.time_to_s, told.choice) == (-0.02, 900.0, 320.0, 2.0)
