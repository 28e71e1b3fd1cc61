"""What other drives confirm: effects that predict keep their evidence, those that only soak up differences lose it."""

from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.atlas import Slopes
from jaxcalib.diagnosis.inference.contest import best_gain, confirmed
from jaxcalib.diagnosis.inference.cross_validation import cross_validated_gains
from jaxcalib.diagnosis.inference.investigation import Prepared
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, UNKNOWN, Explained
from surrogate.effects.registry import effect_named
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null()
SIZE = len(NULL.cells)
NUM_DRIVES = 8
RIGHT = 1.5 * np.random.default_rng(1).standard_normal(SIZE)
# as large in each feature, but of another sign in every other one
WRONG = RIGHT * np.where(np.arange(SIZE) % 2, 1.0, -1.0)


def signature(name: str, shift: np.ndarray) -> Signature:
    strengths = effect_named(name).medium * np.asarray([0.0, 1.0, 2.0])
    return Signature(name, {}, strengths, np.outer([0.0, 1.0, 2.0], shift), np.zeros((3, SIZE)))


def drives(strength: float, seed: int) -> DriveTallies:
    """Return drives whose pooled features have the null's covariance, and an effect."""
    root = np.linalg.cholesky(NULL.covariance)
    noise = np.sqrt(NUM_DRIVES) * np.random.default_rng(seed).standard_normal((NUM_DRIVES, SIZE)) @ root.T
    above = NULL.mean + NULL.deviation * (strength * RIGHT + noise)
    return DriveTallies(NULL.cells, above, np.ones_like(above), np.zeros(NUM_DRIVES))


def prepared(tallies: DriveTallies) -> Prepared:
    more = NUM_DRIVES / len(tallies)
    deviation = np.sqrt(more) * NULL.deviation
    null = replace(NULL, deviation=deviation, slope=NULL.slope / np.sqrt(more))
    zeros = np.zeros_like(NULL.slope)
    return Prepared(
        tallies, null, null.standardised(tallies.values()), Slopes(zeros, zeros, zeros), np.zeros(len(null.cells))
    )


def test_only_what_predicts_gains():
    signatures = {"memory": [signature("memory", RIGHT)], "keep_right": [signature("keep_right", WRONG)]}
    gains = [
        cross_validated_gains(list(signatures), prepared(drives(1.4, seed)), prepared, signatures, {})
        for seed in range(10)
    ]
    right, wrong = (np.asarray([one[name] for one in gains]) for name in signatures)
    assert (right > 0.0).all()
    assert (right > wrong).all()
    assert np.median(wrong) < 0.7 * np.median(right)  # noise of the right size is worth something, and not as much
    nothing = [
        cross_validated_gains(["memory"], prepared(drives(0.0, seed)), prepared, signatures, {})["memory"]
        for seed in range(10)
    ]
    assert np.mean(nothing) < 0.5


def test_too_few_drives_say_nothing():
    few = prepared(drives(1.4, 2).take([0, 1, 2]))
    assert cross_validated_gains(["memory"], few, prepared, {"memory": [signature("memory", RIGHT)]}, {}) == {}


def test_evidence_counts_as_far_as_it_is_confirmed():
    found = [
        Explained("memory", 140.0, 0.5), Explained("grade", 150.0, 0.02), Explained("keep_right", 130.0, 3.0),
        Explained(UNKNOWN, 120.0), Explained(NONE, 100.0), Explained("ramp_inflow_error", 103.0, 0.2),
    ]  # fmt: skip
    judged = confirmed(found, {"memory": 25.0, "grade": -8.0, "keep_right": 10.0})
    counted = {one.name: one.log_evidence for one in judged}
    assert counted == pytest.approx(
        {"memory": 140.0, "keep_right": 125.0, UNKNOWN: 120.0, "ramp_inflow_error": 103.0, NONE: 100.0, "grade": 92.0}
    )
    assert [one.name for one in judged][:2] == ["memory", "keep_right"]
    assert best_gain(judged) == pytest.approx(40.0)
    assert confirmed(found, {}) == sorted(found, key=lambda one: -one.log_evidence)
