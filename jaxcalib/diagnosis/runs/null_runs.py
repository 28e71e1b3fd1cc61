"""SUMO with the calibrated values, seen through the same sensors: what the field would look like without any effect."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.features import DriveTallies, TallyBook, gather_tallies
from jaxcalib.diagnosis.features.identities import count_identities
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.disk import checked_disk, writing_to_scratch
from jaxcalib.runs.drives_in_turn import interleaved
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest
from sim_adapters.shared_runs import departures_s, drives_worth, starts_apart
from sim_adapters.sumo.simulator import SensorRange, SumoSimulator
from sim_adapters.sumo.workers import SumoWorkers
from surrogate.effects.base import Effect, EffectSetting
from surrogate.effects.recorded_drives import alter_drive
from surrogate.effects.registry import EFFECTS, effect_named
from surrogate.road.drive_table import DriveTable, as_logged, drive_table
from surrogate.road.perception import PerceptionFrame

MOST_FAILED_SHARE = 0.5
Alteration = tuple[str, float]  # effect and strength
PLAIN: Alteration = ("", 0.0)


@dataclass(frozen=True)
class NullRuns:
    """Tallies of SUMO runs and of altered versions of some of them.

    Attributes:
        plain: tallies as they are.
        altered: tallies with one effect put in, by effect and strength; the first runs of `plain`.
    """

    plain: DriveTallies
    altered: Mapping[Alteration, DriveTallies]


@dataclass(eq=False)
class DriveCounter:
    """Counts drives and altered versions of the first ones; SUMO's adapter wants numbers, so it is given a ticket."""

    features: DriveFeatures  # what is counted
    interval_s: float  # time between frames
    num_altered: int  # of how many drives altered versions are counted, too
    alterations: Sequence[Alteration]
    first_seed: int
    books: list[dict[Alteration, TallyBook]] = field(default_factory=list)  # tallies of each drive

    def __call__(self, frames: PerceptionFrame) -> np.ndarray:
        """Count a drive."""
        number = len(self.books)
        table = as_logged(drive_table(frames, self.interval_s), self.features.road.log)
        books = {PLAIN: self.features.of_table(table)}
        if number < self.num_altered:
            books |= {alteration: self._count_altered(table, alteration, number) for alteration in self.alterations}
        self.books.append(books)
        return np.full(1, float(number))

    def _count_altered(self, table: DriveTable, alteration: Alteration, number: int) -> TallyBook:
        effect, strength = effect_named(alteration[0]), alteration[1]
        random = np.random.default_rng((self.first_seed, number))
        altered = alter_drive(table, effect, strength, self.features.road.log, random)
        if effect.is_sensor_s:
            return self.features.of_table(altered)
        book = TallyBook()
        count_identities(altered, self.features.road, book)
        return book


def fine_interval_s(problem: CalibrationProblem) -> float:
    """Return the interval at which identities are judged: that of the logs, in steps of the simulation.

    Logs that are sampled more slowly than features of traffic need are brought to that interval.
    """
    step_s = problem.parts.scenario.step_s
    sampled_s = max(float(np.median(np.diff(drive.subject.time_s))) for drive in problem.drives)
    steps, steps_per_frame = max(1, round(sampled_s / step_s)), round(problem.frame_interval_s / step_s)
    return steps * step_s if steps_per_frame % steps == 0 else problem.frame_interval_s


def alterations_of(interval_s: float, frame_interval_s: float) -> list[Alteration]:
    """Which effects at which strengths are put into the null runs; slow logs do not show when drivers act.

    Args:
        interval_s: at which identities are judged.
        frame_interval_s: at which traffic is.
    """
    chosen: list[Alteration] = []
    for effect in EFFECTS:
        if effect.is_sensor_s:
            chosen += [(effect.name, strength) for strength in sensor_strengths(effect, interval_s)]
        elif interval_s < frame_interval_s:
            chosen += [(effect.name, strength) for strength in effect.rhythms_s]
    return chosen


def sensor_strengths(effect: Effect, interval_s: float) -> tuple[float, ...]:
    """Strengths at which a sensor's effect is put into recorded drives."""
    strengths = (effect.weak, effect.medium, effect.strong)
    if effect.is_whole_steps:
        multiples = sorted({max(1, round(strength / interval_s)) for strength in strengths})
        strengths = tuple(round(multiple * interval_s, 4) for multiple in multiples)  # as measured ones are
    return (*strengths, *(-strength for strength in strengths[1:])) if effect.is_signed else strengths


def starts_of_runs(problem: CalibrationProblem) -> list[tuple[DriveStart, ...]]:
    """Return the drives, dealt to runs with several subject vehicles each."""
    starts = interleaved(problem.drive_starts())
    return starts_apart(starts) if problem.template.can_share_runs else [(one,) for one in starts]


def num_runs_for(problem: CalibrationProblem, num_drives: int) -> int:
    """Number of runs that tell as much as so many drives with a run of their own."""
    dealt = starts_of_runs(problem)
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
    alterations: Sequence[Alteration],
    first_seed: int,
    on_runs: Callable[[int], None],
    effects: Mapping[str, EffectSetting] | None = None,
    first_run: int = 0,
    workers: SumoWorkers | None = None,
) -> NullRuns:
    """Run SUMO with parameter values and count the drives.

    Args:
        problem: the problem.
        features: what is counted.
        values: parameter values.
        num_runs: number of runs; they stand for the drives in turn.
        num_altered: of how many drives altered versions are counted, too.
        alterations: effect and strength of each.
        first_seed: seed of run 0.
        on_runs: told of runs done.
        effects: put into the scenario by SUMO's own means; none for the null.
        first_run: number of the first run, where others were made before.
        workers: who makes the runs; processes of this machine unless given.

    Raises:
        AllRunsFailedError: more than half of the runs failed.
        ResourceError: the disk is full.
    """
    counter = DriveCounter(features, fine_interval_s(problem), num_altered, alterations, first_seed)
    runs = range(first_run, first_run + num_runs)
    requests = _requests(problem, values, runs, first_seed, effects or {})
    outcomes = _run(problem, counter, requests, on_runs, workers)
    good = [outcome for outcome in outcomes if outcome.status.is_ok]
    if len(good) < (1.0 - MOST_FAILED_SHARE) * len(outcomes):
        tail = next((outcome.log_tail for outcome in outcomes if outcome.log_tail), "")
        raise AllRunsFailedError("the calibrated values failed in SUMO", tail)
    kept = [(outcome.request, counter.books[int(outcome.observed[0])]) for outcome in good]

    def gathered(alteration: Alteration) -> DriveTallies:
        shown = [(request, books[alteration]) for request, books in kept if alteration in books]
        departs_s, seeds = ([getattr(request, name) for request, _ in shown] for name in ("depart_s", "seed"))
        return gather_tallies([book for _, book in shown], departs_s, [seed - first_seed for seed in seeds])

    return NullRuns(gathered(PLAIN), {alteration: gathered(alteration) for alteration in alterations})


def _requests(
    problem: CalibrationProblem,
    values: np.ndarray,
    runs: range,
    first_seed: int,
    effects: Mapping[str, EffectSetting],
) -> list[RunRequest]:
    """Return a request for each drive of the runs."""
    dealt, vector = starts_of_runs(problem), tuple(float(value) for value in values)
    requests = []
    for run in runs:
        starts = dealt[run % len(dealt)]
        also_s = tuple(one.depart_s for one in starts) if len(starts) > 1 else ()
        requests += [RunRequest(vector, first_seed + run, one.depart_s, effects, also_s, one.drive) for one in starts]
    return requests


def _run(
    problem: CalibrationProblem,
    counter: DriveCounter,
    requests: Sequence[RunRequest],
    on_runs: Callable[[int], None],
    workers: SumoWorkers | None,
) -> list[RunOutcome]:
    """Make runs in SUMO, whose drives are counted, and return their outcomes in the order of the requests."""
    perception = problem.case.perception
    outcomes = []
    with SumoSimulator(
        scenario=problem.scenario,
        layout=problem.layout,
        fold=counter,
        sensor=SensorRange(perception.ahead_m, perception.behind_m),
        subject_vehicle=problem.parts.subject.vehicle,
        frame_interval_s=counter.interval_s,
        end_s=problem.parts.scenario.duration_s,
        workers=workers,
        recorded=problem.template.recorded,
        draws_phases=True,  # the field's is not known, and what differs by it alone is no gap
    ) as simulator:
        with writing_to_scratch():
            waiting = simulator.submit(requests)
        for request, wait in zip(requests, waiting, strict=True):
            with writing_to_scratch():  # a run that failed is made again
                outcomes += checked_disk([wait()])
            on_runs(int(request.depart_s == departures_s(request)[-1]))
    return outcomes
