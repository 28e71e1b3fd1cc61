"""The calibration's own search with an effect in: what parameters fit once what they had hidden is there.

Steps along slopes do not find back from values that a strong effect has bent far. The search begins at what the logs
say instead, and takes no longer in the surrogate than it did without the effect. What the surrogate itself gets wrong
shifts both results alike, so their difference counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.calibration.stages.two_stage import search_two_stages
from jaxcalib.calibration.value_search import SearchedValues
from jaxcalib.diagnosis.runs.trial_engine import SPARE_CAPACITY
from jaxcalib.problem.engines import surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSurrogate
from jaxcalib.runs.seeds import SEARCH_SEED
from jaxcalib.runs.session import Session
from sim_adapters.interface import ParameterLayout, RunOutcome, RunRequest, Simulator
from surrogate.effects.base import EffectSetting


@dataclass(frozen=True)
class WithEffects:
    """A simulator all of whose runs contain the same effects."""

    simulator: Simulator  # what makes the runs; it knows effects
    effects: Mapping[str, EffectSetting]  # by name

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of the parameter vectors."""
        return self.simulator.layout

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs, with the effects, and return their outcomes in the same order."""
        return self.simulator.run([replace(request, effects=self.effects) for request in requests])


@dataclass(frozen=True)
class Recalibrator:
    """Searches parameter values with an effect in."""

    problem: CalibrationProblem
    searched: SearchedValues  # the search without effects
    base: np.ndarray  # values that came of that search, once SUMO had corrected them
    budget: Budget  # its numbers of runs
    session: Session  # of the diagnosis

    def values(self, effects: Mapping[str, EffectSetting]) -> np.ndarray | None:
        """Return the calibrated values with effects in; None where runs with them fail."""
        engine = surrogate_engine(
            self.problem, SPARE_CAPACITY, decision_interval_s=self.searched.decision_interval_s
        ).with_effects()
        evaluator = Evaluator(
            WithEffects(JournaledSurrogate(engine, self.session.journal), effects),
            self.problem.departs_s("fit"),
            self.session.first_seed + SEARCH_SEED,
            self.session.progress.surrogate_runs,
        )
        initial = self.searched.initial
        try:
            search = search_two_stages(
                self.problem, initial, evaluator, Settings(), self.budget, self.session.timed_apart()
            )
        except AllRunsFailedError:
            return None
        with_effects, without = initial.space.values_of(np.stack([search.best, self.searched.found.best]))
        return np.maximum(self.base + with_effects - without, 0.0)
