"""What is exported: traffic of a few vehicles, instant by instant, and what a calibration has left."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxcalib.importers.trajectories import Slice
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.sumo.trajectories import VehicleKind

KINDS = {
    "ego": VehicleKind(4.8, 1.8, 1.5, "passenger"),
    "lorry.7": VehicleKind(14.0, 2.5, 3.6, "truck"),
    "Ego": VehicleKind(2.2, 0.9, 1.5, "motorcycle"),
}


def slice_at(time_s: float, vehicles: Mapping[str, tuple[float, float, float, float]]) -> Slice:
    """Vehicles with place (x, y), heading and speed at an instant."""
    nothing = np.full(len(vehicles), np.nan)
    x_m, y_m, heading_rad, speed_mps = np.asarray(list(vehicles.values()), float).reshape(-1, 4).T
    return Slice(time_s, np.asarray(list(vehicles)), x_m, y_m, heading_rad, speed_mps, nothing, nothing, nothing)


def run_of_the_scenario(folder: Path, problem: CalibrationProblem) -> Path:
    """RUN with the scenario's own values."""
    values, layout = problem.template.base_values().tolist(), problem.layout
    parameters = {
        "demand": dict(zip(layout.input_ids, values, strict=False)),
        "behaviour": {"car": dict(zip(layout.attributes, values[2:], strict=True))},
    }
    folder.mkdir()
    (folder / "result.json").write_text(json.dumps({"format": 1, "parameters": parameters, "seeds": {"search": 0}}))
    return folder
