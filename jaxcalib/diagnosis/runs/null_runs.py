"""SUMO with the calibrated values, seen through the same sensors: what the field would look like without any effect."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.features import DriveTallies, TallyBook, gather_tallies
from jaxcalib.diagnosis.features.identities import count_identities
from jaxcalib.problem.problem import FRAME_INTERVAL_S, CalibrationProblem
from jaxcalib.runs.disk import checked_disk, writing_to_scratch
from sim_adapters.interface import RunRequest
from sim_adapters.shared_runs import departures_apart, departures_s, drives_worth
from sim_adapters.sumo.simulator import SensorRange, SumoSimulator
from surrogate.effects.base import Effect, EffectSetting
from surrogate.effects.recorded_drives import alter_drive
from surrogate.effects.registry import EFFECTS, effect_named
from surrogate.road.drive_table import DriveTable, as_logged, drive_table
from surrogate.road.perception import PerceptionFrame

MOST_FAILED_SHARE = 0.5


@dataclass(frozen=True)
class NullRuns:
    """Tallies of SUMO runs and of altered versions of some of them.

    Attributes:
        plain: tallies as they are.
        altered: tallies with one effect put in, by effect and strength; the first runs of `plain`.
    """

    plain: DriveTallies
    altered: Mapping[tuple[str, float], DriveTallies]


class TableFold:
    """Keeps the tallies of each run; SUMO's adapter wants numbers, so it is given a ticket."""

    def __init__(self, interval_s: float, count: Callable[[DriveTable], dict[tuple[str, float], TallyBook]]) -> None:
        """Prepare; `count` returns the tallies of a drive, by effect and strength."""
        self._interval_s = interval_s
        self._count = count
        self.books: list[dict[tuple[str, float], TallyBook]] = []

    def __call__(self, frames: PerceptionFrame) -> np.ndarray:
        """Count a drive."""
        self.books.append(self._count(drive_table(frames, self._interval_s)))
        return np.full(1, float(len(self.books) - 1))


def fine_interval_s(problem: CalibrationProblem) -> float:
    """Return the interval at which identities are judged: that of the logs, in steps of the simulation.

    Logs that are sampled more slowly than features of traffic need are brought to that interval.
    """
    step_s = problem.parts.scenario.step_s
    sampled_s = max(float(np.median(np.diff(drive.subject.time_s))) for drive in problem.drives)
    steps = max(1, round(sampled_s / step_s))
    interval_s = steps * step_s
    whole = abs(FRAME_INTERVAL_S / interval_s - round(FRAME_INTERVAL_S / interval_s)) < 1e-6
    return interval_s if whole and interval_s < FRAME_INTERVAL_S else FRAME_INTERVAL_S


def alterations_of(interval_s: float) -> list[tuple[str, float]]:
    """Which effects at which strengths are put into the null runs; slow logs do not show when drivers act."""
    chosen: list[tuple[str, float]] = []
    for effect in EFFECTS:
        if effect.is_sensor_s:
            chosen += [(effect.name, strength) for strength in sensor_strengths(effect, interval_s)]
        elif interval_s < FRAME_INTERVAL_S:
            chosen += [(effect.name, strength) for strength in effect.rhythms_s]
    return chosen


def sensor_strengths(effect: Effect, interval_s: float) -> tuple[float, ...]:
    """Strengths at which a sensor's effect is put into recorded drives."""
    strengths = (effect.weak, effect.medium, effect.strong)
    if effect.is_whole_steps:
        strengths = tuple(sorted({max(1, round(strength / interval_s)) * interval_s for strength in strengths}))
    return (*strengths, *(-strength for strength in strengths[1:])) if effect.is_signed else strengths


def departures_of_runs(problem: CalibrationProblem) -> list[tuple[float, ...]]:
    """Return the drives' departures, dealt to runs with several subject vehicles each."""
    departs_s = sorted({drive.depart_s for drive in problem.case.drives})
    return departures_apart(departs_s) if problem.template.can_share_runs else [(depart_s,) for depart_s in departs_s]


def num_runs_for(problem: CalibrationProblem, num_drives: int) -> int:
    """Number of runs that tell as much as so many drives with a run of their own."""
    dealt = departures_of_runs(problem)
    per_round = sum(map(len, dealt))
    if per_round == len(dealt):
        return num_drives
    num_runs = math.ceil(num_drives * len(dealt) / drives_worth(per_round, len(dealt)))
    return len(dealt) * math.ceil(num_runs / len(dealt))  # each departure equally often


def run_null(
    problem: CalibrationProblem,
    features: DriveFeatures,
    values: np.ndarray,
    num_runs: int,
    num_altered: int,
    alterations: Sequence[tuple[str, float]],
    first_seed: int,
    on_runs: Callable[[int], None],
    effects: Mapping[str, EffectSetting] | None = None,
    first_run: int = 0,
) -> NullRuns:
    """Run SUMO with parameter values.

    Args:
        problem: the problem.
        features: what is counted.
        values: parameter values.
        num_runs: number of runs; departures are those of the drives, in turn.
        num_altered: of how many drives altered versions are counted, too.
        alterations: effect and strength of each.
        first_seed: seed of run 0.
        on_runs: told of runs done.
        effects: put into the scenario by SUMO's own means; none for the null.
        first_run: number of the first run, where others were made before.

    Raises:
        AllRunsFailedError: more than half of the runs failed.
        ResourceError: the disk is full.
    """
    interval_s = fine_interval_s(problem)
    road = features.road
    number = [0]

    def count(table: DriveTable) -> dict[tuple[str, float], TallyBook]:
        table = as_logged(table, road.log)
        books = {("", 0.0): features.of_table(table)}
        if number[0] < num_altered:
            for name, strength in alterations:
                random = np.random.default_rng((first_seed, number[0]))
                effect = effect_named(name)
                altered = alter_drive(table, effect, strength, road.log, random)
                if effect.is_sensor_s:
                    books[name, strength] = features.of_table(altered)
                else:
                    books[name, strength] = TallyBook()
                    count_identities(altered, road, books[name, strength])
        number[0] += 1
        return books

    fold = TableFold(interval_s, count)
    perception = problem.case.perception
    dealt, told = departures_of_runs(problem), tuple(float(value) for value in values)
    requests = []
    for run in range(first_run, first_run + num_runs):
        departs_s = dealt[run % len(dealt)]
        also_s = departs_s if len(departs_s) > 1 else ()
        requests += [RunRequest(told, first_seed + run, depart_s, effects or {}, also_s) for depart_s in departs_s]
    outcomes = []
    with SumoSimulator(
        scenario=problem.scenario,
        layout=problem.layout,
        fold=fold,
        sensor=SensorRange(perception.ahead_m, perception.behind_m),
        subject_vehicle=problem.parts.subject.vehicle,
        frame_interval_s=interval_s,
        end_s=problem.parts.scenario.duration_s,
    ) as simulator:
        with writing_to_scratch():
            waiting = simulator.submit(requests)
        for request, wait in zip(requests, waiting, strict=True):
            with writing_to_scratch():  # a run that failed is made again
                outcomes += checked_disk([wait()])
            on_runs(int(request.depart_s == departures_s(request)[-1]))
    good = [outcome for outcome in outcomes if outcome.status.is_ok]
    if len(good) < (1.0 - MOST_FAILED_SHARE) * len(requests):
        tail = next((outcome.log_tail for outcome in outcomes if outcome.log_tail), "")
        raise AllRunsFailedError("the calibrated values failed in SUMO", tail)
    kept = [(outcome.request, fold.books[int(outcome.observed[0])]) for outcome in good]

    def gathered(key: tuple[str, float]) -> DriveTallies:
        of_key = [(request, books[key]) for request, books in kept if key in books]
        departs_s, runs = ([getattr(request, name) for request, _ in of_key] for name in ("depart_s", "seed"))
        return gather_tallies([book for _, book in of_key], departs_s, [run - first_seed for run in runs])

    return NullRuns(gathered(("", 0.0)), {key: gathered(key) for key in alterations})
