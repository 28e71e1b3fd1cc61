"""The calibration's search with an effect in; search and simulator are made up."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.confirmation import Confirmation
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.calibration.stages.two_stage import TwoStageResult
from jaxcalib.calibration.value_search import SearchedValues
from jaxcalib.diagnosis.runs import recalibration
from jaxcalib.diagnosis.runs.recalibration import Recalibrator, WithEffects
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.seeds import SEEDS_PER_CALIBRATION
from jaxcalib.runs.session import open_session
from sim_adapters.interface import ParameterLayout, RunOutcome, RunRequest, Status
from surrogate.effects.base import EffectSetting


@dataclass
class Listener:
    """A simulator that keeps what it is asked."""

    asked: list[RunRequest]
    layout: ParameterLayout = ParameterLayout((), (), (), ())

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Keep the requests, and let them succeed."""
        self.asked = list(requests)
        return [RunOutcome(one, Status.OK, np.ones(1), np.zeros(1, int), np.zeros(1, int), 0) for one in requests]


def test_all_runs_get_the_effects():
    listener, effects = Listener([]), {"memory": EffectSetting(0.8)}
    requests = [RunRequest((1.0, 2.0), seed, 300.0) for seed in (4, 9)]
    assert len(WithEffects(listener, effects).run(requests)) == 2
    assert [(one.values, one.seed, one.depart_s) for one in listener.asked] == [
        (one.values, one.seed, one.depart_s) for one in requests
    ]
    assert all(one.effects == effects for one in listener.asked)


class Space:
    """A parameter space whose unit is 10."""

    def values_of(self, unit: np.ndarray) -> np.ndarray:
        """Return values."""
        return 10.0 * unit


def test_the_search_is_made_with_the_effects_and_its_difference_counts(monkeypatch: pytest.MonkeyPatch):
    """Where the search with the effects ends less where it ended without them is added to what is gone on from."""
    listener = Listener([])
    effects = {"local_speed_reduction": EffectSetting(0.15)}
    monkeypatch.setattr(recalibration, "surrogate_engine", lambda problem, room, decision_interval_s: listener)
    monkeypatch.setattr(Listener, "with_effects", lambda self: self, raising=False)
    monkeypatch.setattr(recalibration, "JournaledSurrogate", lambda engine, journal: engine)
    seeds = []

    def search(problem, initial, evaluator, settings, budget, session):
        evaluator.evaluate(np.asarray([[1.0, 2.0]]), 3)
        seeds.extend(request.seed for request in listener.asked)
        return SimpleNamespace(best=np.asarray([0.7, 0.2]))

    monkeypatch.setattr(recalibration, "search_two_stages", search)
    problem = cast(CalibrationProblem, SimpleNamespace(departs_s=lambda role: (300.0,)))
    found = cast(TwoStageResult, SimpleNamespace(best=np.asarray([0.4, 0.5])))
    initial = cast(InitialPoint, SimpleNamespace(space=Space()))
    budget = cast(Budget, None)
    searched = SearchedValues(
        budget, initial, found, cast(Confirmation, None), agreements=(), is_in_sumo=False, num_surrogate_runs=0,
        num_sumo_search_runs=0, warnings=(),
    )  # fmt: skip
    with open_session(None, {}, seed=2) as session:
        recalibrator = Recalibrator(problem, searched, np.asarray([21.0, 2.0]), budget, session)
        values = recalibrator.values(effects)
    assert values is not None
    np.testing.assert_allclose(values, [24.0, 0.0])  # no value below 0
    assert [request.effects for request in listener.asked] == 3 * [effects]
    assert seeds == [2 * SEEDS_PER_CALIBRATION + k for k in range(3)]  # those of the search without effects

    def fail(*arguments):
        raise AllRunsFailedError("all runs failed", "")

    monkeypatch.setattr(recalibration, "search_two_stages", fail)
    assert recalibrator.values(effects) is None
