"""One run of SUMO whose trajectories are kept, with what each vehicle is."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.sumo.question import refusal, start_worker

PRECISION = 4  # digits behind the point of places in m and speeds in m/s


@dataclass(frozen=True)
class VehicleKind:
    """What a vehicle is."""

    length_m: float
    width_m: float
    height_m: float
    vehicle_class: str  # SUMO's


class Recorded(TypedDict):
    """What the worker says."""

    vehicles: dict[str, tuple[float, float, float, str]]  # `VehicleKind` by id


def record_trajectories(
    scenario: Scenario,
    layout: ParameterLayout,
    values: Sequence[float],
    depart_s: float,
    subject_vehicle: str,
    end_s: float,
    seed: int,
    file: Path,
    longest_s: float,
) -> Mapping[str, VehicleKind]:
    """Run a scenario until the subject vehicle has arrived, and write floating car data from its departure on.

    Args:
        scenario: what to run.
        layout: meaning of the values.
        values: parameter values.
        depart_s: when the subject vehicle departs.
        subject_vehicle: its id.
        end_s: when the run ends at the latest.
        seed: of SUMO.
        file: where SUMO writes; ends in .xml or .xml.gz.
        longest_s: how long it may compute.

    Returns:
        What each vehicle is, by id, those that left before the file begins among them.

    Raises:
        ScenarioError: SUMO ended without writing, in its words.
    """
    with tempfile.TemporaryDirectory(prefix="jaxcalib-") as folder:
        written = write_scenario(scenario, layout, values, depart_s, subject_vehicle, Path(folder))
        arguments = [
            "-c", str(written.config), "--seed", str(seed), "--fcd-output", str(file.absolute()),
            "--fcd-output.acceleration", "true", "--device.fcd.begin", repr(float(depart_s)),
            "--precision", str(PRECISION),
            "--no-step-log", "true", "--duration-log.disable", "true",
        ]  # fmt: skip
        question = {"arguments": arguments, "end_s": end_s, "subject": subject_vehicle}
        said, lines = start_worker("sim_adapters.sumo.trajectories_worker", question, longest_s, Recorded)()
    if said is None or not file.is_file():
        raise ScenarioError(scenario.configuration.file, f"SUMO ends a run of the scenario: {refusal(lines)}")
    return {name: VehicleKind(*kind) for name, kind in said["vehicles"].items()}
