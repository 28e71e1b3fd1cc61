"""A case: the folder that ties a SUMO scenario to the logs of drives on that road."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from jaxcalib.case.case_faults import file_faults, name_faults, time_faults
from jaxcalib.case.case_file import FILE_NAME, read_case_table
from jaxcalib.case.case_sections import BehaviourSection, DriveSection, SubjectSection
from jaxcalib.case.log_form import LogForm
from jaxcalib.case.log_units import log_form_of
from jaxcalib.case.safety_limits import USUAL_LIMITS, SafetyLimits
from jaxcalib.errors import CaseError, raise_faults
from surrogate.subject.registry import SUBJECT_MODELS, SubjectModel
from surrogate.vehicle.model_entry import ParameterRangeError, UnknownModelError

Role = Literal["fit", "held_out"]
ROLES: tuple[Role, ...] = ("fit", "held_out")


@dataclass(frozen=True)
class Scenario:
    """The SUMO scenario."""

    config_file: Path  # SUMO configuration
    warmup_s: float  # time that is not measured
    duration_s: float  # end of the simulation, from time 0, warm-up included
    step_s: float  # length of a simulation step


@dataclass(frozen=True)
class SubjectVehicle:
    """The automated vehicle in the scenario's demand."""

    vtype: str
    vehicle: str  # its id
    model: SubjectModel = field(default_factory=SubjectModel)  # who drives it


@dataclass(frozen=True)
class Perception:
    """What the subject vehicle can see."""

    ahead_m: float  # range ahead, front bumper to front bumper
    behind_m: float  # range behind
    nominal_length_m: float  # length assumed for a detected vehicle

    def scaled(self, factor: float) -> "Perception":
        """The same with another range."""
        return replace(self, ahead_m=factor * self.ahead_m, behind_m=factor * self.behind_m)


@dataclass(frozen=True)
class Behaviour:
    """What Stage 2 may calibrate.

    Attributes:
        vtypes: background vTypes.
        car_following: their car-following model.
        parameters: vType attributes that may be moved; None means the library's list for that model.
        distant_vtypes: vType as which each of these vTypes follows beyond the sensors' range.
        common: what vTypes that move together share: "factors", so that they keep their proportions, or "values".
        apart: which vTypes have parameters of their own: "each", "trucks" apart from all others, or groups; None where
            all move together.
    """

    vtypes: tuple[str, ...]
    car_following: str
    parameters: tuple[str, ...] | None
    distant_vtypes: Mapping[str, str] = field(default_factory=dict)
    common: Literal["factors", "values"] = "factors"
    apart: Literal["each", "trucks"] | tuple[tuple[str, ...], ...] | None = None


@dataclass(frozen=True)
class Input:
    """An entrance of the road, one decision variable of Stage 1."""

    id: str  # its name
    flows: tuple[str, ...]  # ids of the flows that are scaled together, their shares kept
    windows_s: tuple[float, ...] = ()  # begin of each window of time with a factor of its own; none for one factor


@dataclass(frozen=True)
class Drive:
    """One recorded drive."""

    id: str  # its name
    depart_s: float  # when the subject vehicle departs, on the scenario's clock
    subject_file: Path  # table of the subject vehicle
    objects_file: Path  # table of the detected vehicles
    role: Role  # whether the calibration may use it
    time_zero: float | None = None  # value of the tables' time at the scenario's time 0; None for the log's common one


@dataclass(frozen=True)
class Case:
    """Everything that case.toml says."""

    folder: Path  # the case's folder, absolute
    name: str  # name of the case
    perception: Perception  # range of the sensors
    drives: tuple[Drive, ...]  # recorded drives
    scenario: Scenario | None  # the SUMO scenario, None where the case has none yet
    subject: SubjectVehicle | None  # the subject vehicle in it
    behaviour: Behaviour | None  # what Stage 2 calibrates
    inputs: tuple[Input, ...]  # what Stage 1 calibrates, empty where the case says nothing
    log_form: LogForm = LogForm()  # how the drives' tables are written
    safety: SafetyLimits[float] = USUAL_LIMITS  # limits of the safety measures

    def drives_of(self, role: Role) -> tuple[Drive, ...]:
        """Return the drives of one role."""
        return tuple(drive for drive in self.drives if drive.role == role)


@dataclass(frozen=True)
class ScenarioParts:
    """The parts that a case may leave out, all there."""

    scenario: Scenario
    subject: SubjectVehicle
    behaviour: Behaviour
    inputs: tuple[Input, ...]


def read_case(folder: Path | str) -> Case:
    """Read and check case.toml.

    Args:
        folder: the case's folder.

    Raises:
        CaseError: a key is missing, unknown or wrong, two things have one name, a file is missing, or no drive is left
            to fit; the first fault, with the others that are of one kind with it.
    """
    root = Path(folder)
    table = read_case_table(root)
    root = root.resolve()
    raise_faults([*name_faults(table), *time_faults(table), *file_faults(table, root)])
    scenario = table.scenario and Scenario(
        config_file=root / table.scenario.config,  # which may lie outside, so that logs can stay where they are
        warmup_s=table.scenario.warmup_s,
        duration_s=table.scenario.duration_s,
        step_s=table.scenario.step_s,
    )
    perception = table.perception
    return Case(
        folder=root,
        name=table.name,
        perception=Perception(perception.ahead_m, perception.behind_m, perception.nominal_length_m),
        drives=tuple(_drive(root, drive) for drive in table.drive),
        scenario=scenario,
        subject=table.subject and _subject(table.subject),
        behaviour=table.behaviour and _behaviour(table.behaviour),
        inputs=tuple(Input(entrance.id, entrance.flows, entrance.windows_s) for entrance in table.input),
        log_form=log_form_of(table.log),
        safety=table.safety.limits,
    )


def require_scenario(case: Case) -> ScenarioParts:
    """Return the parts that a simulation needs.

    Raises:
        CaseError: the case leaves one of them out.
    """
    if case.scenario is None or case.subject is None or case.behaviour is None:
        parts = {
            "[scenario]": case.scenario,
            "[subject]": case.subject,
            "[behaviour]": case.behaviour,
        }
        missing = ", ".join(name for name, part in parts.items() if not part)
        raise CaseError(FILE_NAME, missing, "expected for everything that runs the scenario; missing here.")
    return ScenarioParts(case.scenario, case.subject, case.behaviour, case.inputs)


def _subject(section: SubjectSection) -> SubjectVehicle:
    model = SubjectModel(section.model, section.parameters or {})
    try:
        model.check()
    except UnknownModelError as error:
        key = "model" if section.model not in SUBJECT_MODELS else "parameters"
        raise CaseError(FILE_NAME, f"subject.{key}", f"expected a known name: {error}") from None
    except ParameterRangeError as error:
        raise CaseError(FILE_NAME, "subject.parameters", f"expected a value within its range: {error}") from None
    return SubjectVehicle(section.vtype, section.vehicle, model)


def _behaviour(section: BehaviourSection) -> Behaviour:
    return Behaviour(
        vtypes=section.vtypes,
        car_following=section.car_following,
        parameters=section.parameters,
        distant_vtypes=section.distant_vtypes or {},
        common=section.common,
        apart=section.apart,
    )


def _drive(root: Path, drive: DriveSection) -> Drive:
    return Drive(
        id=drive.id,
        depart_s=drive.depart_s,
        subject_file=root / drive.subject,
        objects_file=root / drive.objects,
        role="fit" if drive.role == "fit" else "held_out",
        time_zero=drive.time_zero,
    )
