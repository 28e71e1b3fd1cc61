"""Recall, precision and F1 of encounters: by hand, and what a right simulation reaches."""

import numpy as np
import pytest

from jaxcalib.measures.encounters import KINDS, SEVERITIES, encounter_tally
from jaxcalib.validation.encounters import compare_encounters
from jaxcalib.validation.observer import ObservedDrives

NAMES = ("other", *(encounter_tally(kind, severity) for kind in KINDS for severity in SEVERITIES))


def observed(counts: np.ndarray) -> ObservedDrives:
    """Return drives with counts of encounters, [..., kind and severity]."""
    tally = np.concatenate([np.full((*counts.shape[:-1], 1), 7.0), counts], axis=-1)
    return ObservedDrives(tally, {}, np.zeros((*counts.shape[:-1], 1)))


def test_what_is_shared_is_recalled_and_precise():
    field, rounds = np.zeros((2, 12)), np.zeros((4, 2, 12))
    field[0, 0], field[1, 0], field[1, 1] = 2.0, 1.0, 1.0  # cut-ins: 3 mild, 1 medium
    rounds[:, 0, 0], rounds[:, 1, 2] = 2.0, 4.0  # 2 mild, 4 severe
    rounds[3, :, :] = 0.0  # a round without any
    found = compare_encounters(NAMES, observed(field), observed(rounds))["cut_in"]
    assert found["field"] == {"mild": 3.0, "medium": 1.0, "severe": 0.0}
    assert found["simulated"] == {"mild": 1.5, "medium": 0.0, "severe": 3.0}
    assert found["recall"] == pytest.approx(3 / 4 * 2 / 4)
    assert found["precision"] == pytest.approx(2 / 6)  # of the rounds that have any
    assert found["f1"] == pytest.approx(3 / 4 * 4 / 10)
    # among themselves: one of three with two like it and one without any, and one with none like it
    assert found["among_simulated"] == pytest.approx((3 * 2 / 3 + 0.0) / 4)


def test_kinds_that_nobody_meets_say_nothing():
    found = compare_encounters(NAMES, observed(np.zeros((2, 12))), observed(np.zeros((4, 2, 12))))
    assert all(one["recall"] is one["f1"] is one["limit"] is None for one in found.values())


def test_few_rounds_have_no_limit_of_one_in_twenty():
    random = np.random.default_rng(3)
    for number, has_limit in ((18, False), (19, True)):
        rounds = observed(random.poisson(1.0, (number, 6, 12)).astype(float))
        found = compare_encounters(NAMES, observed(random.poisson(1.0, (6, 12)).astype(float)), rounds)["all"]
        assert (found["limit"] is not None) == has_limit
        assert found["among_simulated"] > 0.0


def test_a_right_simulation_is_rarely_below_its_limit_and_a_wrong_one_is():
    random = np.random.default_rng(4)
    rates = random.uniform(0.1, 1.5, 12)
    below, wrong = [], []
    for _ in range(60):
        rounds = observed(random.poisson(rates, (20, 6, 12)).astype(float))
        right = compare_encounters(NAMES, observed(random.poisson(rates, (6, 12)).astype(float)), rounds)["all"]
        other = compare_encounters(NAMES, observed(random.poisson(rates[::-1], (6, 12)).astype(float)), rounds)["all"]
        below.append(right["f1"] < right["limit"])
        wrong.append(other["f1"] < other["limit"])
    assert np.mean(below) < 0.15
    assert np.mean(wrong) > 0.8
