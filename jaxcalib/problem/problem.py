"""Everything that a calibration starts from: the case, its scenario, its logs, and what the logs measure."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxcalib.case.case import Case, Role, ScenarioParts, read_case, require_scenario
from jaxcalib.case.safety_limits import SafetyLimits
from jaxcalib.errors import CaseError
from jaxcalib.field.covered_parts import coverage_warnings, covered_m, recorded_parts
from jaxcalib.field.drive_logs import read_drives
from jaxcalib.field.field_log import DriveLog
from jaxcalib.field.seen_range import range_warnings, seen_perception
from jaxcalib.field.sensor_errors import HONEST, SensorErrors
from jaxcalib.measures.drive_tally import DriveTally
from jaxcalib.measures.lane_change import num_target_gap_classes
from jaxcalib.measures.measure import Measure
from jaxcalib.measures.observed_road import ObservedRoad, observe_road
from jaxcalib.measures.registry import all_folds, all_measures
from jaxcalib.measures.scene import MeasureSettings
from jaxcalib.measures.whole_drive import WholeDriveFold
from jaxcalib.problem.drive_warnings import departure_warnings, length_warnings, one_sided_warnings
from jaxcalib.problem.inputs import read_scenario_of
from jaxcalib.problem.parameter_layout import layout_of
from jaxcalib.problem.problem_checks import (
    clock_faults,
    drive_faults,
    input_faults,
    model_faults,
    raise_first,
    vtype_warnings,
)
from sim_adapters.activity import Activity, doing
from sim_adapters.errors import ScenarioError
from sim_adapters.interface import NO_DRIVE, DriveStart, ParameterLayout
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import nearest_model
from sim_adapters.world.logged_drive import LoggedDrive, resample
from sim_adapters.world.recorded_parts import RecordedParts
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.subject.registry import REPLAY

FRAME_INTERVAL_S = 0.5  # about; a whole number of steps
FRAMES_STEP = 128
LEAST_SPEED_MPS = 2.0  # below it a time headway means nothing
LONGEST_HEADWAY_S = 6.0  # behind it a vehicle does not follow its leader
SPARE_TRACKS = 2.5  # simulated drives may meet more vehicles than the field's
LEAST_SHARE = 0.1  # of the route, for which room for vehicles is made as if it were all of it


@dataclass(frozen=True)
class CalibrationProblem:
    """What a calibration starts from."""

    case: Case
    parts: ScenarioParts  # the parts of it that simulations need
    scenario: Scenario  # the SUMO scenario
    template: WorldTemplate  # what all surrogate worlds of it share
    tally: DriveTally  # what is counted in a drive
    fold: WholeDriveFold  # the same for drives that are there already
    measures: Mapping[str, Measure]  # what is made of tallies, by name
    drives: tuple[DriveLog, ...]  # logs of the drives
    field_tally: np.ndarray  # tallies of each drive, [drive, tally]
    sensor_errors: SensorErrors = HONEST  # what the sensors of the drives to fit got wrong
    # drives without rows, and where less was seen than the case states, one line each
    log_warnings: tuple[str, ...] = ()

    @property
    def frame_interval_s(self) -> float:
        """Time between two frames of the subject vehicle's sensors, in the field and in both simulators."""
        return frame_interval_s(self.scenario.configuration.step_s)

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of parameter vectors."""
        return self.template.layout

    @property
    def road(self) -> ObservedRoad:
        """The observed road."""
        return self.tally.settings.road

    @property
    def tally_names(self) -> tuple[str, ...]:
        """Names of the tallies."""
        return self.tally.names

    @functools.cached_property
    def tally_index(self) -> Mapping[str, int]:
        """Place of each tally in the vector."""
        return {name: index for index, name in enumerate(self.tally_names)}

    @property
    def model(self) -> str:
        """Car-following model of the background vehicles, or the nearest one that the surrogate has."""
        return nearest_model(self.parts.behaviour.car_following)

    def drive_starts(self, role: Role | None = None) -> tuple[DriveStart, ...]:
        """Return when the subject vehicle departs in each drive of a role, or of all.

        Drives that depart alike are told apart only where runs of them differ by more than chance.
        """
        recorded, is_repeated = self.template.recorded, bool(self.template.logged_drives)
        tells = [is_repeated or bool(recorded and not recorded[number].is_whole) for number in range(len(self.drives))]
        return tuple(
            DriveStart(drive.depart_s, number if tells[number] else NO_DRIVE)
            for number, drive in enumerate(self.case.drives)
            if role in (None, drive.role)
        )

    def field_of(self, role: Role) -> np.ndarray:
        """Return the tallies of the drives of a role, [drive, tally]."""
        return self.field_tally[[drive.role == role for drive in self.drives]]

    def warnings(self) -> tuple[str, ...]:
        """Return what a user should know of the inputs, one line each."""
        early = [drive.id for drive in self.case.drives if drive.depart_s < self.parts.scenario.warmup_s]
        own = [f"case.toml: drives that depart within the warm-up: {', '.join(early)}."] if early else []
        own += vtype_warnings(self.scenario, self.layout)
        if self.template.distant_vtypes:
            own.append(
                "case.toml: behaviour.distant_vtypes: in plain SUMO nobody changes over, so not in RUN/scenario."
            )
        own += self.log_warnings
        own += departure_warnings(self.case, self.drives)
        own += one_sided_warnings(self.case, self.drives)
        own += coverage_warnings(self.template.recorded, self.drives, self.scenario.network.length_m)
        own += length_warnings(self.case, self.scenario, self.drives)
        return (
            *own,
            *self.scenario.warnings,
            *(line for drive in self.drives for line in drive.warnings),
        )


@doing(Activity.READING)
def read_problem(folder: Path | str, *, as_stated: bool = False) -> CalibrationProblem:
    """Read a case, its scenario and its logs, and measure the field.

    Args:
        folder: the case's folder.
        as_stated: take the sensors' range as the case states it, even where the logs end well before, and drives with
            all that sensors got wrong.

    Raises:
        CaseError: something in them is wrong; one line says what.
    """
    case = read_case(folder)
    parts = require_scenario(case)
    try:
        scenario, parts = read_scenario_of(parts)
        raise_first([*model_faults(scenario, parts), *input_faults(scenario, parts)])
        layout = layout_of(parts, scenario)
        raise_first(clock_faults(scenario, parts, case))
        interval_s = frame_interval_s(scenario.configuration.step_s)
        logs = read_drives(case, scenario.row_map, corrects_sensors=not as_stated)
        raise_first(logs.refusals)
        case, drives = logs.case, logs.drives
        stated = seen = case.perception
        corrections = () if as_stated else logs.sensor_errors.warnings()
        if not as_stated:
            seen = seen_perception(drives_to_fit(drives), stated)
            # what is reported too far away is cut off before the range's end
            case = dataclasses.replace(case, perception=seen.scaled(1.0 / logs.sensor_errors.most_factor))
        sensor = case.perception
        drives = tuple(dataclasses.replace(drive, ahead_m=sensor.ahead_m, behind_m=sensor.behind_m) for drive in drives)
        reach_m, distant = (sensor.ahead_m, sensor.behind_m), parts.behaviour.distant_vtypes
        template = build_template(scenario, layout, parts.subject.model, reach_m, distant)
    except ScenarioError as error:
        raise CaseError(error.file, "", error.message) from None
    if parts.subject.model.name == REPLAY:
        template = dataclasses.replace(template, logged_drives=_logged_drives(case, drives, parts, interval_s))
    template = dataclasses.replace(template, recorded=recorded_parts(case.drives, drives, scenario))
    settings = _measure_settings(case, scenario, drives, template.recorded)
    tally = DriveTally(settings, all_folds(settings))
    longest_s = max(parts.scenario.duration_s - drive.depart_s for drive in case.drives)
    num_frames = FRAMES_STEP * int(np.ceil((longest_s / interval_s + 2) / FRAMES_STEP))
    fold = WholeDriveFold(tally, num_frames)
    field_tally, is_seen = [], []
    for drive in drives:  # one after the other: frames of all together would fill the memory
        frames = drive.frames(interval_s)
        field_tally.append(fold(frames))
        is_seen.append(bool(np.any(frames.valid)))
    raise_first(drive_faults(case, drives, is_seen, interval_s))
    return CalibrationProblem(
        case=case,
        parts=parts,
        scenario=scenario,
        template=template,
        tally=tally,
        fold=fold,
        measures=all_measures(settings),
        drives=drives,
        field_tally=np.stack(field_tally),
        sensor_errors=logs.sensor_errors,
        log_warnings=(*logs.left_out, *logs.contradictions, *range_warnings(stated, seen), *corrections),
    )


def drives_to_fit(drives: Sequence[DriveLog]) -> tuple[DriveLog, ...]:
    """Return the drives that a calibration may use."""
    return tuple(drive for drive in drives if drive.role == "fit")


def _logged_drives(
    case: Case, drives: tuple[DriveLog, ...], parts: ScenarioParts, interval_s: float
) -> tuple[LoggedDrive, ...]:
    """Return the drives on the clock of the simulators, gaps of their logs bridged."""
    logged = []
    for drive, log in zip(case.drives, drives, strict=True):
        even = log.on_clock(interval_s)
        subject, valid = even.subject, np.asarray(even.valid)
        columns = (subject.time_s, subject.position_m, subject.speed_mps, subject.row)
        time_s, position_m, speed_mps, row = (column[valid] for column in columns)
        try:
            logged.append(resample(time_s, position_m, speed_mps, row, parts.scenario.step_s))
        except ValueError as error:
            raise CaseError(drive.subject_file, "", f"expected a drive that can be replayed: {error}") from None
    return tuple(logged)


def frame_interval_s(step_s: float) -> float:
    """The whole number of steps that is nearest to half a second; at least one step."""
    return max(1, round(FRAME_INTERVAL_S / step_s)) * step_s


def _measure_settings(
    case: Case, scenario: Scenario, drives: tuple[DriveLog, ...], recorded: tuple[RecordedParts, ...]
) -> MeasureSettings:
    length_m, sensor = scenario.network.length_m, case.perception
    shares = [max(covered_m(one.parts_m, length_m) / length_m, LEAST_SHARE) for one in recorded] or [1.0] * len(drives)
    # simulated drives number whom they see all along the route
    seen = [len(np.unique(drive.objects.track)) / share for drive, share in zip(drives, shares, strict=True)]
    most_tracks = max(seen or [0])
    return MeasureSettings(
        road=observe_road(scenario),
        nominal_length_m=jnp.asarray(sensor.nominal_length_m, jnp.float32),
        least_speed_mps=jnp.asarray(LEAST_SPEED_MPS, jnp.float32),
        longest_headway_s=jnp.asarray(LONGEST_HEADWAY_S, jnp.float32),
        limits=SafetyLimits(*(jnp.asarray(limit, jnp.float32) for limit in case.safety)),
        num_tracks=FRAMES_STEP * int(np.ceil((SPARE_TRACKS * most_tracks + 2) / FRAMES_STEP)),
        num_target_gap_classes=num_target_gap_classes(sensor.ahead_m, sensor.behind_m, sensor.nominal_length_m),
    )
