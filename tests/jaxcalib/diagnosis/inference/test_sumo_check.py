"""What SUMO's own runs make of a surrogate's signatures, on made-up tallies."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import measured_shift
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained, explain, explain_none
from jaxcalib.diagnosis.inference.sumo_check import LOOKED_AT, check_in_sumo, corrected, worth_a_look
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null()
SIZE = len(NULL.cells)
NUM_RUNS = 400
DIRECTION = 3.0 * np.random.default_rng(1).standard_normal(SIZE)
WRONG = DIRECTION + 2.0 * np.random.default_rng(2).standard_normal(SIZE)


def runs(shift: np.ndarray, seed: int) -> DriveTallies:
    """Return runs whose features are the null's, shifted by so many units of noise."""
    spread = np.sqrt(8.0) * np.random.default_rng(seed).standard_normal((NUM_RUNS, SIZE))
    above = NULL.mean + NULL.deviation * (shift + spread)
    return DriveTallies(NULL.cells, above, np.ones_like(above), np.zeros(NUM_RUNS))


def signature(name: str, shift: np.ndarray) -> Signature:
    return Signature(name, {}, np.asarray([0.0, 1.0, 2.0]), np.outer([0.0, 1.0, 2.0], shift), np.zeros((3, SIZE)))


def test_the_measured_signature_is_the_difference_in_units_of_noise():
    shift, error = measured_shift(runs(DIRECTION, 3), runs(np.zeros(SIZE), 4), NULL)
    np.testing.assert_allclose(error, np.sqrt(2.0 * 8.0 / NUM_RUNS), rtol=0.15)
    z = (shift - DIRECTION) / np.sqrt(8.0 / NUM_RUNS)
    assert np.abs(z).max() < 4.5
    assert z.std() == pytest.approx(1.0, abs=0.35)


def test_a_correction_is_a_mean_of_both_and_grows_with_strength():
    one = signature("memory", WRONG)
    error = np.full(SIZE, 0.3)
    found = corrected(one, one, 1.5, 1.5 * DIRECTION, error)
    np.testing.assert_array_equal(found.shift[0], 0.0)
    np.testing.assert_allclose(found.shift[2] - one.shift[2], 2.0 * (found.shift[1] - one.shift[1]))
    there, remaining = found.at(1.5)
    low, high = np.minimum(1.5 * WRONG, 1.5 * DIRECTION), np.maximum(1.5 * WRONG, 1.5 * DIRECTION)
    assert ((there >= low - 1e-9) & (there <= high + 1e-9)).all()
    assert (remaining <= error + 1e-9).all()
    unseen = corrected(one, one, 1.5, 1.5 * DIRECTION, np.full(SIZE, np.inf))
    np.testing.assert_array_equal(unseen.shift, one.shift)


def test_where_the_surrogate_shows_nothing_sumo_is_believed():
    is_shown = np.arange(SIZE) % 4 > 0
    one = replace(signature("memory", np.where(is_shown, WRONG, 0.0)), is_shown=is_shown)
    error = np.where(np.arange(SIZE) % 8 > 0, 0.3, np.inf)
    found = corrected(one, one, 1.5, 1.5 * DIRECTION, error)
    there, _ = found.at(1.5)
    alone, nowhere = ~is_shown & np.isfinite(error), ~is_shown & np.isinf(error)
    np.testing.assert_allclose(there[alone], 1.5 * DIRECTION[alone])
    np.testing.assert_allclose(found.error[2][alone], 2.0 / 1.5 * 0.3)
    np.testing.assert_array_equal(there[nowhere], 0.0)
    np.testing.assert_array_equal(found.is_shown, ~nowhere)


LITTLE = 1.0  # misfit by chance: what any explanation leaves makes evidence worth little


def test_the_right_effect_overtakes_one_that_the_surrogate_favours():
    random = np.random.default_rng(8)
    difference = np.linalg.cholesky(NULL.covariance) @ random.standard_normal(SIZE) + 1.2 * DIRECTION
    signatures = {"memory": [signature("memory", WRONG)], "grade": [signature("grade", 0.8 * DIRECTION + 0.4)]}

    def explained(several):
        found = [explain(difference, NULL, one, 1.0) for one in several.values()]
        return sorted([*found, explain_none(difference, NULL)], key=lambda one: -one.log_evidence)

    asked = []

    def run(name: str, setting, is_first_look: bool) -> DriveTallies:
        asked.append((name, is_first_look))
        return runs(setting.strength * DIRECTION, 9)

    assert explained(signatures)[0].name == "grade"
    checked = check_in_sumo(
        NULL, runs(np.zeros(SIZE), 4), signatures, LITTLE, explained, lambda name: name == "memory", run
    )
    assert asked == [("memory", True), ("memory", False)]
    assert checked.explained[0].name == "memory"
    assert checked.explained[0].strength == pytest.approx(1.2, rel=0.25)
    (check,) = checked.checks
    assert (check.effect, check.num_runs) == ("memory", NUM_RUNS)
    assert check.agreement is not None
    # against the surrogate's signature as it was, not as the first look has corrected it
    precision = np.linalg.inv(NULL.covariance)
    lengths = np.sqrt((WRONG @ precision @ WRONG) * (DIRECTION @ precision @ DIRECTION))
    assert check.agreement == pytest.approx(WRONG @ precision @ DIRECTION / lengths, abs=0.02)
    assert checked.num_look_runs == NUM_RUNS
    assert checked.signatures["grade"] == signatures["grade"]


def test_effects_far_behind_are_not_looked_at():
    found = [
        Explained("memory", 300.0, best_misfit=80.0),
        Explained("ramp_inflow_error", 290.0),
        Explained("unknown", 280.0),
        Explained("grade", 300.0 - 3.9 * LOOKED_AT, best_misfit=120.0),
        Explained("keep_right", 300.0 - 4.1 * LOOKED_AT, best_misfit=120.0),
        Explained("none", 0.0, best_misfit=900.0),
    ]
    assert worth_a_look(found, 40.0) == ["memory", "ramp_inflow_error", "grade"]  # the temperature is 4


def test_once_one_explains_the_drives_others_are_not_looked_at():
    """Two effects that the surrogate shows half of: whichever comes first ends the looking if it is the right one."""
    difference = 3.0 * DIRECTION
    half = {"memory": [signature("memory", 0.5 * DIRECTION)], "grade": [signature("grade", 0.5 * DIRECTION + 0.1)]}

    def explained(several):
        found = [explain(difference, NULL, one, 1.0) for one in several.values()]
        return sorted([*found, explain_none(difference, NULL)], key=lambda one: -one.log_evidence)

    def asked_of(true: str) -> list[str]:
        asked = []

        def run(name: str, setting, is_first_look: bool) -> DriveTallies:
            asked.append(name)
            return runs(setting.strength * (3.0 if name == true else 0.5) * DIRECTION, 9)

        check_in_sumo(NULL, runs(np.zeros(SIZE), 4), half, float(SIZE), explained, lambda name: True, run)
        return asked

    first = explained(half)[0].name
    other = next(name for name in half if name != first)
    assert set(asked_of(first)) == {first}
    assert asked_of(other)[:2] == [first, other]


def test_what_fails_in_sumo_keeps_the_surrogate_s_signature():
    signatures = {"memory": [signature("memory", WRONG)], "keep_right": [signature("keep_right", DIRECTION)]}
    asked = []

    def explained(several):
        found = [explain(2.0 * DIRECTION, NULL, one, 1.0) for one in several.values()]
        return sorted([*found, explain_none(2.0 * DIRECTION, NULL)], key=lambda one: -one.log_evidence)

    def run(name: str, setting, is_first_look: bool) -> None:
        asked.append((name, is_first_look))

    checked = check_in_sumo(NULL, runs(np.zeros(SIZE), 4), signatures, float(SIZE), explained, lambda name: True, run)
    assert asked == [("keep_right", True), ("keep_right", False)]  # the other is far behind
    assert checked.checks == ()
    assert checked.signatures == signatures


def test_of_two_directions_sumo_shows_the_likelier_one_and_corrects_that_alone():
    more, less = signature("cooperative_yielding", -0.3 * DIRECTION), signature("cooperative_yielding", WRONG)
    less = replace(less, sign=-1.0)
    difference = np.linalg.cholesky(NULL.covariance) @ np.random.default_rng(8).standard_normal(SIZE) + 1.2 * DIRECTION

    def explained(several):
        return [*(explain(difference, NULL, one, 1.0) for one in several.values()), explain_none(difference, NULL)]

    asked = []

    def run(name: str, setting, is_first_look: bool) -> DriveTallies:
        asked.append(setting.strength)
        return runs(-setting.strength * DIRECTION, 9)

    signatures = {"cooperative_yielding": [more, less]}
    checked = check_in_sumo(NULL, runs(np.zeros(SIZE), 4), signatures, LITTLE, explained, lambda _: True, run)
    assert max(asked) < 0.0
    untouched, found = checked.signatures["cooperative_yielding"]
    assert untouched is more
    assert np.abs(found.shift[1] - DIRECTION).mean() < 0.5 * np.abs(WRONG - DIRECTION).mean()
    assert checked.explained[0].strength == pytest.approx(-1.2, rel=0.25)
