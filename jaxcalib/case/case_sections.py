"""The sections and keys of case.toml, and what each value may be."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from jaxcalib.case.log_section import LogSection, Number
from jaxcalib.case.safety_limits import USUAL_LIMITS, SafetyLimits

LONGEST_NAME = 200

# Every number has bounds on both sides, for TOML knows `inf` and `nan`.
PositiveLength = Annotated[float, Meta(gt=0.0, le=100_000.0, description="a number > 0 and at most 100000")]
_VEHICLE = "a vehicle's length in m, a number > 0 and at most 30"  # the longest lorries of Europe have 25.25 m
VehicleLength = Annotated[float, Meta(gt=0.0, le=30.0, description=_VEHICLE)]
Instant = Annotated[float, Meta(ge=0.0, le=1e7, description="a number >= 0 and at most 1e7")]
Duration = Annotated[float, Meta(gt=0.0, le=1e7, description="a number > 0 and at most 1e7")]
StepLength = Annotated[float, Meta(gt=0.0, le=10.0, description="a number > 0 and at most 10")]
Limit = Annotated[float, Meta(gt=0.0, le=60.0, description="a number > 0 and at most 60")]
Way = Annotated[float, Meta(gt=0.0, le=1000.0, description="a number > 0 and at most 1000")]
Name = Annotated[
    str,
    Meta(
        min_length=1,
        max_length=LONGEST_NAME,
        pattern=r"^[^\x00-\x1f\x7f]+$",
        description=f"text of 1 to {LONGEST_NAME} characters, none of them a control character",
    ),
]
FileStem = Annotated[
    str,
    Meta(
        min_length=1,
        max_length=LONGEST_NAME,
        pattern=r"^[^\x00-\x1f\x7f/\\.][^\x00-\x1f\x7f/\\]*$",  # results of a drive may be filed under its id
        description=f"text of 1 to {LONGEST_NAME} characters without / and \\, not beginning with a dot",
    ),
]
FilePath = Annotated[str, Meta(min_length=1, max_length=4096, description="the path of a file")]
Names = Annotated[tuple[Name, ...], Meta(min_length=1, description="a list of at least one name")]
GROUPS = '"each", "trucks" or a list of lists of vTypes'
Groups = Annotated[tuple[Names, ...], Meta(min_length=1, description=GROUPS)]


class SafetySection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [safety]: `SafetyLimits`, each of its keys optional."""

    ttc_s: Limit = USUAL_LIMITS.ttc_s
    near_miss_ttc_s: Limit = USUAL_LIMITS.near_miss_ttc_s
    drac_mps2: Limit = USUAL_LIMITS.drac_mps2
    full_braking_mps2: Limit = USUAL_LIMITS.full_braking_mps2
    threat_number: Limit = USUAL_LIMITS.threat_number
    hard_braking_mps2: Limit = USUAL_LIMITS.hard_braking_mps2
    encroachment_s: Limit = USUAL_LIMITS.encroachment_s
    after_cut_in_s: Limit = USUAL_LIMITS.after_cut_in_s
    urgent_way_m: Way = USUAL_LIMITS.urgent_way_m

    @property
    def limits(self) -> SafetyLimits[float]:
        """The limits as measures take them."""
        return SafetyLimits(**msgspec.structs.asdict(self))


class ScenarioSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [scenario]."""

    config: FilePath
    warmup_s: Instant
    duration_s: Duration
    step_s: StepLength


class SubjectSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [subject]."""

    vtype: Name
    vehicle: Name
    model: Name = "vtype"
    parameters: Annotated[dict[str, float], Meta(description="a table of numbers by name")] | None = None


class PerceptionSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [perception]."""

    ahead_m: PositiveLength
    behind_m: PositiveLength
    reference: Annotated[str, Meta(pattern="^front$", description='"front" (front bumper to front bumper)')]
    nominal_length_m: VehicleLength


class BehaviourSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [behaviour]."""

    vtypes: Names
    car_following: Name
    parameters: Names | None = None
    distant_vtypes: Annotated[dict[str, str], Meta(description="a table of vTypes by vType")] | None = None
    common: Annotated[Literal["factors", "values"], Meta(description='"factors" or "values"')] = "factors"
    apart: Annotated[Groups | Literal["each", "trucks"], Meta(description=GROUPS)] | None = None


class InputSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One [[input]]."""

    id: Name
    flows: Names
    windows_s: Annotated[
        tuple[Instant, ...], Meta(min_length=2, description="a list of at least two numbers >= 0 and at most 1e7")
    ] = ()


class DriveSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One [[drive]]."""

    id: FileStem
    depart_s: Instant
    subject: FilePath
    objects: FilePath
    role: Annotated[str, Meta(pattern="^(fit|held_out)$", description='"fit" or "held_out"')]
    time_zero: Number | None = None


class CaseTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    format: Annotated[int, Meta(ge=1, le=1, description="1, the format that this version reads")]
    name: Name
    perception: PerceptionSection
    scenario: ScenarioSection | None = None
    subject: SubjectSection | None = None
    behaviour: BehaviourSection | None = None
    log: LogSection | None = None
    safety: SafetySection = SafetySection()
    input: tuple[InputSection, ...] = ()
    drive: tuple[DriveSection, ...] = ()
