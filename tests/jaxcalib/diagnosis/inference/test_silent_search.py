"""Surfaces lead to silent values that explain the drives, each from where the last one led; the road is made up."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.silent_search import MOST_SURFACES, Found, SilentSearch
from jaxcalib.diagnosis.inference.silent_values import OpenValues
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.trials import Trial

NUM_FEATURES, NUM_RUNS, NUM_CONFIRMING = 40, 8, 32
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"measure {k}") for k in range(NUM_FEATURES))
VALUES = np.asarray([3600.0, 1.1, 1.0, 0.1])  # an inflow, a time gap, and two weights of which the logs are silent
LOW, HIGH = np.asarray([3000.0, 1.0, 0.2, 0.0]), np.asarray([4000.0, 1.2, 5.0, 3.5])
GOAL = np.asarray([3600.0, 1.1, 4.1, 0.5])
IS_SILENT = np.asarray([False, False, True, True])
ANSWER = np.random.default_rng(3).normal(0.0, 3.0, (3, NUM_FEATURES))


def road(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Features that saturate, and of which a third answers to both weights at once: no surface of second order."""
    gain, right = (np.asarray(values) / HIGH)[2:]
    return np.tanh(2.0 * gain) * ANSWER[0] + np.tanh(2.0 * right) * ANSWER[1] + 2.0 * gain * right * ANSWER[2]


def runs(values: Sequence[float], number: int, answers: bool = True, noise: float = 0.5) -> DriveTallies:
    random = np.random.default_rng([int(1e6 * value) for value in values])  # as unlike as runs of other values are
    above = 20.0 + answers * road(values) + noise * random.standard_normal((number, NUM_FEATURES))
    return DriveTallies(CELLS, above, np.ones_like(above), np.zeros(number))


def null() -> NullModel:
    unit, nothing = np.eye(NUM_FEATURES), np.zeros((NUM_FEATURES, 1))
    return NullModel(CELLS, 20.0 + road(VALUES), np.ones(NUM_FEATURES), unit, unit, nothing, np.ones(1))


def searched(
    goal: np.ndarray = GOAL, answers: bool = True, failing: float = np.inf, seed: int = 0, noise: float = 0.5
) -> tuple[Found, list[Trial]]:
    """Return what is found where the drives are as the road at a goal, and all trials that this takes."""
    made: list[Trial] = []

    def run(part: str, trials: Sequence[Trial]) -> Mapping[str, DriveTallies]:
        made.extend(trials)
        empty = DriveTallies(CELLS, np.zeros((NUM_CONFIRMING, NUM_FEATURES)), np.zeros((NUM_CONFIRMING, NUM_FEATURES)),
                             np.zeros(NUM_CONFIRMING))  # fmt: skip
        return {
            trial.name: empty if trial.values[2] > failing else runs(trial.values, trial.num_runs, answers, noise)
            for trial in trials
        }

    difference = road(goal) - road(VALUES) + np.random.default_rng([seed, 7]).standard_normal(NUM_FEATURES)
    search = SilentSearch(null(), run, NUM_RUNS, NUM_CONFIRMING, seed)
    here = runs(VALUES.tolist(), NUM_CONFIRMING, answers, noise)
    return search.search(OpenValues(VALUES, IS_SILENT, LOW, HIGH), difference, here), made


@pytest.mark.parametrize("seed", range(3))
def test_surfaces_lead_to_the_goal(seed: int):
    found, made = searched(seed=seed)
    assert found.num_moves >= 1
    assert found.gain > LEAST_EVIDENCE
    np.testing.assert_array_equal(found.values[:2], VALUES[:2])
    left, before = (np.std(road(values) - road(GOAL)) for values in (found.values, VALUES))
    assert left < 0.5 < 2.0 < before  # in units of noise
    silent = np.asarray([trial.values for trial in made])
    assert np.all((silent >= LOW - 1e-9) & (silent <= HIGH + 1e-9))
    assert {trial.num_runs for trial in made} == {NUM_RUNS, NUM_CONFIRMING}
    assert len(made) <= MOST_SURFACES * 18


def test_each_surface_covers_half_of_the_last_one():
    found, made = searched()
    assert found.num_moves >= 1
    surfaces = [np.asarray([trial.values[2] for trial in made[18 * k : 18 * k + 16]]) for k in range(2)]
    first, second = (np.ptp(weights) for weights in surfaces)
    assert second < 0.55 * first


def test_where_the_drives_are_explained_nothing_moves():
    found, made = searched(goal=VALUES)
    assert (found.num_moves, found.gain) == (0, 0.0)
    np.testing.assert_array_equal(found.values, VALUES)
    assert len(made) <= 18


def test_a_road_that_answers_to_nothing_seldom_moves_anything():
    moves = [searched(answers=False, seed=seed, noise=2.0)[0].num_moves for seed in range(20)]
    assert sum(moves) <= 2


def test_values_whose_runs_fail_are_not_gone_to():
    found, _ = searched(failing=3.0)
    assert found.values[2] <= 3.0
    assert searched(failing=0.0)[0].num_moves == 0
