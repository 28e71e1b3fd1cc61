"""What a diagnosis has SUMO run: the null, the scenario as it is, and the best effects; each part is made once."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.features import DriveTallies, joined_tallies
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.null_runs import NullRuns, alterations_of, fine_interval_s, num_runs_for, run_null
from jaxcalib.diagnosis.runs.plan import DiagnosisBudget
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.seeds import CHECK_SEED, DEFAULT_SEED, EXPLAINED_SEED, LOOK_SEED, NULL_SEED
from sim_adapters.sumo.workers import SumoWorkers
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import effect_named


@dataclass(frozen=True)
class SumoRuns:
    """Runs of SUMO for one set of calibrated values."""

    problem: CalibrationProblem
    features: DriveFeatures  # what is counted
    values: np.ndarray  # calibrated values
    plan: DiagnosisBudget  # numbers of runs
    parts: FinishedParts  # keeps finished parts
    first_seed: int  # of the diagnosis; each part has seeds of its own behind it
    on_runs: Callable[[int], None]  # told of runs done
    workers: SumoWorkers | None = None  # who makes the runs; None for processes of this machine
    # strengths of sensors' effects that drives show by themselves: altered versions have them, too
    measured: Mapping[str, float] = field(default_factory=dict)

    def first_null(self) -> NullRuns:
        """Return the first runs with the calibrated values, and altered versions of some: enough to see where to."""
        usual = alterations_of(fine_interval_s(self.problem), self.problem.frame_interval_s)
        alterations = list(dict.fromkeys([*usual, *self.measured.items()]))

        def make() -> dict[str, DriveTallies]:
            runs = run_null(
                self.problem, self.features, self.values, self._runs_for(self.plan.first_null_drives),
                self.plan.altered_drives, alterations, self.first_seed + NULL_SEED, self.on_runs, workers=self.workers,
            )  # fmt: skip
            altered = {f"{name} {strength!r}": tallies for (name, strength), tallies in runs.altered.items()}
            return {"": runs.plain} | altered

        kept = self.parts.tallies(f"null {self._key}", make)
        altered = {(name, strength): kept[f"{name} {strength!r}"] for name, strength in alterations}
        return NullRuns(kept[""], altered)

    def whole_null(self, first: NullRuns) -> NullRuns:
        """Return all runs with the calibrated values, the first ones among them."""
        begin, end = (self._runs_for(number) for number in (self.plan.first_null_drives, self.plan.null_drives))
        if begin >= end:
            return first

        def make() -> dict[str, DriveTallies]:
            runs = run_null(
                self.problem, self.features, self.values, end - begin, 0, (),
                self.first_seed + NULL_SEED, self.on_runs, first_run=begin, workers=self.workers,
            )  # fmt: skip
            return {"": runs.plain}

        further = self.parts.tallies(f"further null {self._key}", make)[""]
        return NullRuns(joined_tallies(first.plain, further), first.altered)

    def default(self) -> DriveTallies | None:
        """Return runs of the scenario as it is; None where they fail, for it may fill the entrance."""
        base = self.problem.template.base_values()
        try:
            return self._plain("default", base, self.plan.default_drives, DEFAULT_SEED)
        except AllRunsFailedError:
            return None

    def with_effect(self, name: str, setting: EffectSetting, is_first_look: bool = False) -> DriveTallies | None:
        """Return runs with the calibrated values and an effect, by SUMO's own means; None where they fail.

        An effect may fill the road until the subject vehicle cannot enter. A first look takes fewer drives.
        """
        word, num_drives, seed = ("check", self.plan.check_drives, CHECK_SEED)
        if is_first_look:  # both count as two measurements: they share no chance
            word, num_drives, seed = ("look", self.plan.look_drives, LOOK_SEED)
        try:
            return self._plain(f"{word} {name} {setting!r}", self.values, num_drives, seed, {name: setting})
        except AllRunsFailedError:
            return None

    def explained(self, name: str, strength: float, values: np.ndarray) -> DriveTallies | None:
        """Return runs with values of their own and an effect; None where they fail.

        A sensor's effect is put into the drives that SUMO makes, any other by SUMO's own means.
        """
        num_runs, seed = self._runs_for(self.plan.refit_drives), self.first_seed + EXPLAINED_SEED
        problem, is_altered = self.problem, effect_named(name).is_sensor_s

        def make() -> dict[str, DriveTallies]:
            alterations = [(name, strength)] if is_altered else []
            effects = {} if is_altered else {name: EffectSetting(strength)}
            num_altered = len(problem.case.drives) * num_runs  # all of them
            runs = run_null(
                problem, self.features, values, num_runs, num_altered, alterations, seed, self.on_runs, effects,
                workers=self.workers,
            )  # fmt: skip
            return {"": runs.altered[name, strength] if is_altered else runs.plain}

        try:
            return self.parts.tallies(f"explained {name} {strength!r} {values.tolist()!r} {self._key}", make)[""]
        except AllRunsFailedError:
            return None

    def _plain(
        self, part: str, values: np.ndarray, num_drives: int, seed: int, effects: dict[str, EffectSetting] | None = None
    ) -> DriveTallies:
        def make() -> dict[str, DriveTallies]:
            runs = run_null(
                self.problem, self.features, values, self._runs_for(num_drives), 0, (), self.first_seed + seed,
                self.on_runs, effects, workers=self.workers,
            )  # fmt: skip
            return {"": runs.plain}

        return self.parts.tallies(f"{part} {self._key}", make)[""]

    def _runs_for(self, num_drives: int) -> int:
        return num_runs_for(self.problem, num_drives)

    @property
    def _key(self) -> str:
        return repr(self.values.tolist())
