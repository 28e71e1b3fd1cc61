"""SUMO as an engine: writes runs' files, has workers make the runs, and turns what they send into outcomes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from sim_adapters.frame_table import ObjectTable, SubjectTable, stack_frames
from sim_adapters.interface import ParameterLayout, RunOutcome, RunRequest, Status
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.shared_runs import departures_s, shared_runs, subject_names
from sim_adapters.sumo.distant import DistantTypes
from sim_adapters.sumo.driver import SubjectControl
from sim_adapters.sumo.job import SumoJob, SumoRun
from sim_adapters.sumo.shared_result import SharedResult
from sim_adapters.sumo.workers import LONGEST_RUN_S, BegunRun, LocalWorkers, SumoWorkers
from sim_adapters.world.recorded_parts import RecordedParts, parts_of, within_parts
from surrogate.road.perception import PerceptionFrame

WHOLE = 1e-6  # of a step: numbers in files are rounded
RADIUS_MARGIN_M = 15.0  # SUMO's radius is measured from another point of the vehicle than our offsets


class FrameFold(Protocol):
    """Turns the frames of a whole drive into numbers; the same fold that the surrogate runs inside its loop."""

    def __call__(self, frames: PerceptionFrame) -> np.ndarray:
        """Return the numbers of a drive whose frames are stacked along a leading time axis."""
        ...


class VehicleCounter(Protocol):
    """Turns the times at which vehicles pass the ends of edges into numbers."""

    @property
    def edges(self) -> tuple[str, ...]:
        """Edges at whose end is counted."""
        ...

    def __call__(self, passed_s: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the numbers of a run from the times at each edge."""
        ...


@dataclass(frozen=True)
class SensorRange:
    """Range of the subject vehicle's sensors."""

    ahead_m: float
    behind_m: float


class SumoSimulator:
    """Makes runs in SUMO. Use it as a context manager: processes of its own end with it."""

    def __init__(
        self,
        scenario: Scenario,
        layout: ParameterLayout,
        fold: FrameFold,
        sensor: SensorRange,
        subject_vehicle: str,
        frame_interval_s: float,
        end_s: float,
        num_processes: int | None = None,
        longest_run_s: float = LONGEST_RUN_S,
        scratch: Path | None = None,
        counter: "VehicleCounter | None" = None,
        control: Callable[[RunRequest], SubjectControl | None] = lambda request: None,
        distant: DistantTypes | None = None,
        workers: SumoWorkers | None = None,
        draws_phases: bool = False,
        recorded: Sequence[RecordedParts] = (),
    ) -> None:
        """Prepare runs; processes start with the first.

        Args:
            scenario: what to run.
            layout: meaning of parameter vectors.
            fold: turns the frames of a drive into numbers.
            sensor: range of the subject vehicle's sensors.
            subject_vehicle: its id.
            frame_interval_s: time between two frames.
            end_s: when runs end at the latest.
            num_processes: processes of its own; one for each core unless given.
            longest_run_s: a run that takes longer in one of them is killed.
            scratch: where files of their runs lie while they are made; the system's folder unless given.
            counter: counts vehicles on the road, up to the end of the run, instead of folding frames.
            control: how to drive the subject vehicle in a run; SUMO drives it unless given.
            distant: which vehicles follow by another vType beyond the sensors' range.
            workers: who makes the runs, and outlives this; processes of its own unless given.
            draws_phases: whether flows at equal intervals have another phase in each run (`draw_phase`).
            recorded: which parts of the route are observed, by number of the drive; all of it unless given.

        Raises:
            ValueError: frames are no whole number of steps apart.
        """
        steps = frame_interval_s / scenario.configuration.step_s
        if abs(steps - max(1, round(steps))) > WHOLE:
            raise ValueError(f"frame_interval_s: expected a whole number of steps of "
                             f"{scenario.configuration.step_s:g} s, got {frame_interval_s:g}.")  # fmt: skip
        self._scenario = scenario
        self._layout = layout
        self._fold = fold
        self._sensor = sensor
        self._subject_vehicle = subject_vehicle
        self._frame_interval_s = frame_interval_s
        self._end_s = end_s
        self._counter = counter
        self._control = control
        self._distant = distant
        self._draws_phases = draws_phases
        self._recorded = recorded
        self._own_workers = None
        if workers is None:
            workers = self._own_workers = LocalWorkers(num_processes, longest_run_s, scratch)
        self._workers = workers
        self._lane_place = _lane_places(scenario)
        entrance_of = {edge: number for number, edge in enumerate(scenario.entrances)}
        self._entrance_of_flow = {flow.id: entrance_of[flow.route[0]] for flow in scenario.flows}
        self._entrance_of_flow |= {
            vehicle.id: entrance_of[vehicle.route[0]]
            for vehicle in scenario.demand.vehicles
            if vehicle.route[0] in entrance_of
        }

    def __enter__(self) -> "SumoSimulator":
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """End the processes that it has started and remove their files."""
        self.close()

    def close(self) -> None:
        """End the processes that it has started and remove their files."""
        if self._own_workers:
            self._own_workers.close()

    @property
    def num_processes(self) -> int:
        """Runs that are made side by side."""
        return self._workers.num_processes

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of the parameter vectors."""
        return self._layout

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order; failures are outcomes, not exceptions."""
        return [outcome() for outcome in self.submit(requests)]

    def submit(self, requests: Sequence[RunRequest]) -> Iterator[Callable[[], RunOutcome]]:
        """Start runs in the background and return, for each, what waits for its outcome."""
        waiting: dict[int, Callable[[], RunOutcome]] = {}
        for numbers in shared_runs(requests):
            first = requests[numbers[0]]
            shared = SharedResult(self.begin(first), len(numbers))
            waiting |= {number: partial(self._answer, shared, requests[number], len(numbers)) for number in numbers}
        return iter([waiting[number] for number in range(len(requests))])

    def _answer(self, shared: SharedResult, request: RunRequest, num_sharing: int) -> RunOutcome:
        result = shared.get()
        if isinstance(result, str):
            return self.failure_of(request, result)
        return self.outcome_of(request, result, num_sharing)

    def begin(self, request: RunRequest) -> BegunRun:
        """Begin a run in the background."""
        return self._workers.begin(partial(self.write, request), request.seed)

    def write(self, request: RunRequest, folder: Path) -> SumoJob:
        """Write a run's files into a folder, and return what there is to do with them.

        Raises:
            ValueError: several subject vehicles, but SUMO alone does not drive them.
        """
        departs_s, control = departures_s(request), self._control(request)
        if len(departs_s) > 1 and (control is not None or self._distant is not None):
            raise ValueError("Expected one subject vehicle where SUMO is told how it, or who is far from it, drives.")
        written = write_scenario(
            self._scenario, self._layout, request.values, departs_s, self._subject_vehicle, folder, "run",
            effects=request.effects, seed=request.seed, draws_phases=self._draws_phases,
        )  # fmt: skip
        return SumoJob(
            config=written.config,
            net_file=self._scenario.configuration.net_file,
            folder=folder,
            seed=request.seed,
            subject_vehicles=subject_names(self._subject_vehicle, departs_s),
            end_s=self._end_s,
            radius_m=max(self._sensor.ahead_m, self._sensor.behind_m) + RADIUS_MARGIN_M,
            frame_interval_s=self._frame_interval_s,
            lane_place=self._lane_place,
            entrance_of_flow=self._entrance_of_flow,
            num_entrances=len(self._scenario.entrances),
            counted_edges=self._counter.edges if self._counter else (),
            control=control,
            distant=self._distant,
        )

    def outcome_of(self, request: RunRequest, run: SumoRun, num_sharing: int = 1) -> RunOutcome:
        """Return the outcome of a run that came to its end.

        Args:
            request: what was asked of it.
            run: what is left of it.
            num_sharing: requests that it answers.
        """
        status, observed = Status.OK, None
        subject = departures_s(request).index(request.depart_s)
        if self._counter is not None:
            observed = self._counter(run.passed_s)
        elif not np.any(run.vehicle == -1 - subject):
            status = Status.SUBJECT_MISSING
        else:
            parts_m = parts_of(self._recorded, request.drive)
            frames = within_parts(self.frames_of(run, subject), parts_m)
            observed = np.asarray(self._fold(frames))
            if not np.isfinite(observed).all():
                status = Status.NONFINITE
            elif not np.any(frames.valid):  # stuck before the part that the logs cover
                status = Status.UNSEEN
        return RunOutcome(
            request=request,
            status=status,
            observed=observed if status.is_ok else None,
            num_arrived=run.num_arrived,
            num_inserted=run.num_inserted,
            num_collisions=run.num_collisions,
            num_subject_overlaps=run.num_subject_overlaps,
            num_teleports=run.num_teleports,
            num_vehicle_steps=run.num_vehicle_steps,
            subject_left=run.subject_left[subject],
            wall_s=run.wall_s / num_sharing,
        )

    def failure_of(self, request: RunRequest, log_tail: str) -> RunOutcome:
        """Return the outcome of a run that failed for good."""
        none = np.zeros(len(self._scenario.entrances), int)
        return RunOutcome(
            request=request,
            status=Status.FAILED,
            observed=None,
            num_arrived=none,
            num_inserted=none,
            num_collisions=0,
            subject_left=False,
            log_tail=log_tail,
        )

    def frames_of(self, run: SumoRun, number: int = 0) -> PerceptionFrame:
        """Return what a subject vehicle, the first unless told, detected in a run; others are vehicles like any."""
        is_subject = run.vehicle == -1 - number
        subject = SubjectTable(
            time_s=run.time_s[is_subject],
            position_m=run.position_m[is_subject],
            speed_mps=run.speed_mps[is_subject],
            acceleration_mps2=run.acceleration_mps2[is_subject],
            row=run.row[is_subject],
            lateral_m=run.lateral_m[is_subject],
            num_lanes=np.zeros(int(is_subject.sum())),
        )
        is_there = ~is_subject & np.isin(run.time_s, subject.time_s)
        instant = np.searchsorted(subject.time_s, run.time_s[is_there])
        objects = ObjectTable(
            instant=instant,
            track=np.where(run.vehicle < 0, run.vehicle.max(initial=0) - run.vehicle, run.vehicle)[is_there],
            row=run.row[is_there],
            offset_m=run.position_m[is_there] - subject.position_m[instant],
            speed_mps=run.speed_mps[is_there],
            lateral_m=run.lateral_m[is_there],
        )
        return stack_frames(subject, objects, self._sensor.ahead_m, self._sensor.behind_m)


def _lane_places(scenario: Scenario) -> dict[str, tuple[int, float, bool]]:
    """Return row, begin on the route's axis, and whether it is carriageway, of each lane and junction lane."""
    network, rows = scenario.network, scenario.row_map.row_of_lane
    places = {}
    for (edge, index), lane in network.lanes.items():
        places[f"{edge}_{index}"] = (rows[(edge, index)], lane.start_m, edge in network.main_edges)
    for name, (before, start_m) in network.junction_lanes.items():
        places[name] = (rows[before], start_m, before[0] in network.main_edges)
    return places
