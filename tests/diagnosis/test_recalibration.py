"""The calibration's search with an effect in, on the corridor."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from jaxcalib.calibration.budget import plan_budget
from jaxcalib.calibration.confirmation import Confirmation
from jaxcalib.calibration.evaluator import Evaluator
from jaxcalib.calibration.two_stage import TwoStageResult
from jaxcalib.diagnosis.recalibration import Recalibrator, WithEffects
from jaxcalib.initial_values.initial_point import find_initial_point
from jaxcalib.journal import Journal
from jaxcalib.pipeline import SearchedValues
from jaxcalib.problem import read_problem
from jaxcalib.progress import Silent
from sim_adapters.interface import ParameterLayout, RunOutcome, RunRequest
from surrogate.effects.base import EffectSetting

CASE = Path(__file__).parents[2] / "experiments" / "cases" / "corridor"


@dataclass
class Listener:
    """A simulator that keeps what it is asked."""

    asked: list[RunRequest]
    layout: ParameterLayout = ParameterLayout((), (), (), ())

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Keep the requests."""
        self.asked = list(requests)
        return []


def test_all_runs_get_the_effects():
    listener, effects = Listener([]), {"memory": EffectSetting(0.8)}
    requests = [RunRequest((1.0, 2.0), seed, 300.0) for seed in (4, 9)]
    assert WithEffects(listener, effects).run(requests) == []
    assert [(one.values, one.seed, one.depart_s) for one in listener.asked] == [
        (one.values, one.seed, one.depart_s) for one in requests
    ]
    assert all(one.effects == effects for one in listener.asked)


@pytest.mark.long
def test_values_move_to_make_up_for_an_effect(tmp_path: Path):
    """Where the surrogate makes all drivers slower, the logs ask for drivers who wish to go faster."""
    problem = read_problem(CASE)
    initial = find_initial_point(problem, 0.2, {}, 0)
    start = initial.space.unit_of(initial.values)
    found = cast(TwoStageResult, SimpleNamespace(best=start))
    confirmed = cast(
        Confirmation, SimpleNamespace(best=np.clip(start + 0.01, 0.0, 1.0))
    )  # SUMO's choice lies elsewhere
    searched = SearchedValues(initial, found, confirmed, cast(Evaluator, None))
    journal = Journal(None)
    recalibrator = Recalibrator(problem, searched, searched.values, plan_budget(problem, 0.05), 0, journal, Silent())

    slower = recalibrator.values({"local_speed_reduction": EffectSetting(0.15)})  # everywhere and always
    assert slower is not None
    assert journal.num_runs > 100
    place = problem.layout.names.index("speedFactor")
    assert slower[place] > 1.05 * searched.values[place]
    one = initial.space.unit_of(slower - searched.values + initial.values)
    assert np.all((one > -0.05) & (one < 1.05))  # what the search found, beside the start
