"""What an importer is given, and what it makes of a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from jaxcalib.importers.data_frame import Frame

USUAL_RANGE_M = 150.0
USUAL_BEGIN_S = 600.0  # on the scenario's clock: its road is filled by then


@dataclass(frozen=True)
class ImportOptions:
    """What a user may choose, whatever the format."""

    subjects: tuple[str, ...] = ()  # ids of vehicles to be taken for subject vehicles; chosen where there are none
    probes: int = 8  # how many are chosen in each recording
    range_m: float | None = None  # of their sensors, ahead and behind; None for the usual, less on a short stretch
    is_occluded: bool = False  # who is hidden behind others is not seen
    begin_s: float | None = None  # when the recording begins, on the scenario's clock; None for the usual
    mapping: Path | None = None  # TOML file with the names that a format leaves open
    crs: str | None = None  # coordinate reference system of places, where the format leaves it open
    config: Path | None = None  # the scenario, if there is one


@dataclass(frozen=True)
class StraightRoad:
    """A straight carriageway as recorded: traffic moves along +x, y is to the left."""

    begin_m: float  # x where the recorded stretch begins
    end_m: float
    right_m: float  # y of the right edge
    widths_m: tuple[float, ...]  # of the lanes, from right to left
    vehicles_per_hour: dict[str, float]  # flows of "car" and "truck"
    lengths_m: dict[str, float]  # typical lengths of both
    speed_limit_mps: float


@dataclass(frozen=True)
class ImportedDrive:
    """The two tables of a drive, in the columns of Table 1 and those of places."""

    id: str
    subject: Frame
    objects: Frame
    range_m: float | None = None  # of a virtual probe's sensors, ahead and behind; probes are in the order of time


@dataclass(frozen=True)
class Imported:
    """What an importer has made of a recording."""

    drives: tuple[ImportedDrive, ...]
    said: tuple[str, ...]  # one line for each thing that was taken, converted or left out
    road: StraightRoad | None = None  # the road, where the recording shows one that a scenario can be made of


class ReadRecording(Protocol):
    """The function `read_recording` of an importer's file."""

    def __call__(self, source: Path, options: ImportOptions) -> Imported:
        """Read a recording.

        Raises:
            CaseError: it cannot be read, or something in it is not what the format promises.
        """
        ...
