"""Trials whose runs failed: an effect that no run survives is not taken for one that does nothing."""

from dataclasses import replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies, TallyBook, gather_tallies
from jaxcalib.diagnosis.features.windows import Window
from jaxcalib.diagnosis.inference.atlas import effect_trials, effects_to_try, surrogate_signatures, told_by_parameters
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.place_search import refine_places
from jaxcalib.diagnosis.runs.trials import BASELINE, FEWEST_PAIRS, has_pairs, paired_difference
from sim_adapters.interface import ParameterLayout
from surrogate.effects.registry import EFFECTS, effect_named
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null()
SIZE = len(NULL.cells)
AGREE = np.zeros(SIZE)  # both simulators do
NUM_RUNS = 8
VALUES = np.asarray([4000.0, 500.0, 1.1])


def trial(num_good: int, shift: float) -> DriveTallies:
    """Return runs of which only the first succeeded."""
    good = np.arange(NUM_RUNS) < num_good
    spread = np.random.default_rng(2).standard_normal((NUM_RUNS, SIZE))
    below = np.tile(good[:, None], (1, SIZE)).astype(float)
    return DriveTallies(NULL.cells, (NULL.mean + shift + spread) * below, below, np.zeros(NUM_RUNS))


def test_no_run_at_all_is_no_feature():
    empty = gather_tallies([TallyBook() for _ in range(NUM_RUNS)], [0.0] * NUM_RUNS)
    assert (len(empty), empty.cells) == (NUM_RUNS, ())
    assert not has_pairs(empty, trial(NUM_RUNS, 0.0))
    difference, error, _ = paired_difference(empty, trial(NUM_RUNS, 0.0), NULL.cells)
    assert (difference == 0.0).all()
    assert np.isinf(error).all()


def test_strengths_whose_runs_failed_are_left_out():
    trials = [one for one in effect_trials(VALUES, NUM_RUNS, {}) if one.effect.name in ("memory", "keep_right")]
    num_good = {0.5: NUM_RUNS, 0.8: FEWEST_PAIRS - 1, 3.0: 0, 5.0: 1}  # by strength
    found = {one.trial.name: trial(num_good[one.strength], one.strength) for one in trials}
    signatures = surrogate_signatures(trials, found | {BASELINE: trial(NUM_RUNS, 0.0)}, NULL, AGREE)
    assert list(signatures) == ["memory"]
    (memory,) = signatures["memory"]
    np.testing.assert_array_equal(memory.strengths, [0.0, 0.5])
    np.testing.assert_allclose(memory.shift[1], 0.5 / NULL.deviation)


LAYOUT = ParameterLayout(("main",), (("f",),), ("car",), ("tau", "lcCooperative", "lcKeepRight"))


def test_an_effect_that_is_a_value_of_a_calibrated_parameter_is_none():
    """Of cooperative yielding lcCooperativeSpeed is a part, too, and no calibration has it here."""
    tried = effects_to_try(LAYOUT)
    assert {effect.name for effect in EFFECTS} - {effect.name for effect in tried} == {
        "keep_right",
        "ramp_inflow_error",
    }
    assert told_by_parameters(effect_named("keep_right"), LAYOUT) == ("lcKeepRight",)
    assert told_by_parameters(effect_named("cooperative_yielding"), LAYOUT) == ()
    assert told_by_parameters(effect_named("memory"), LAYOUT) == ()
    names = {one.effect.name for one in effect_trials(VALUES, NUM_RUNS, {}, tried)}
    assert names == {one.effect.name for one in effect_trials(VALUES, NUM_RUNS, {})} - {"keep_right"}
    both = replace(LAYOUT, attributes=("lcCooperative", "lcCooperativeSpeed"))
    assert "cooperative_yielding" not in {effect.name for effect in effects_to_try(both)}
    assert "keep_right" in {effect.name for effect in effects_to_try(both)}


def test_places_where_all_runs_fail_are_not_moved_to():
    window = Window(900.0, 1300.0)
    trials = effect_trials(VALUES, NUM_RUNS, {"grade": [window]})
    grades = [one for one in trials if one.effect.name == "grade"]
    found = {one.trial.name: trial(NUM_RUNS, one.strength) for one in grades} | {BASELINE: trial(NUM_RUNS, 0.0)}
    signatures = surrogate_signatures(grades, found, NULL, AGREE)
    best = Explained("grade", 30.0, 0.02, (0.01, 0.03), window.setting(), 50.0, signatures["grade"][0].shift[1])

    def fails(several):
        return {BASELINE: trial(NUM_RUNS, 0.0)} | {one.trial.name: trial(0, 0.0) for one in several}

    refined = refine_places(
        signatures["grade"][0].shift[1], NULL, AGREE, [best], signatures, VALUES, NUM_RUNS, (1, 2), fails
    )
    assert refined == signatures


def test_an_effect_of_two_directions_is_tried_in_both():
    trials = effect_trials(VALUES, NUM_RUNS, {})
    for effect in {one.effect.name: one.effect for one in trials}.values():
        strengths = [one.strength for one in trials if one.effect == effect]
        assert (min(strengths) < 0.0) == effect.is_signed
        assert max(strengths) > 0.0
    names = [one.trial.name for one in trials]
    assert len(set(names)) == len(names)
