"""What every format is written from: one run of SUMO that was recorded."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.sumo.trajectories import VehicleKind


@dataclass(frozen=True)
class RecordedRun:
    """A run while the subject vehicle drives."""

    problem: CalibrationProblem
    fcd: Path  # SUMO's floating car data, from the subject vehicle's departure on
    vehicles: Mapping[str, VehicleKind]  # what each vehicle is, by id
    folder: Path  # where the files of the format go
    name: str  # of these files, without their endings

    @property
    def subject(self) -> str:
        """Id of the subject vehicle."""
        return self.problem.parts.subject.vehicle
