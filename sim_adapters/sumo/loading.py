"""Lets SUMO load a scenario and say what it made of it: vTypes with all defaults, ways of trips, or why it refuses.

The process that loads is one of its own: libsumo holds one simulation per process, prints what it has to say, and may
take the process with it.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.configuration import SumoConfiguration
from sim_adapters.scenario.demand_file import trips_without_edges
from sim_adapters.scenario.loaded_scenario import LoadedScenario
from sim_adapters.scenario.scenario_files import copy_without_outputs

LONGEST_LOADING_S = 300.0
MOST_LINES = 20


def load_in_sumo(configuration: SumoConfiguration) -> LoadedScenario:
    """Load a scenario in SUMO.

    Args:
        configuration: what to load.

    Raises:
        ScenarioError: SUMO refuses; in its own words.
    """
    files = [*configuration.additional_files, *configuration.route_files]
    with tempfile.TemporaryDirectory(prefix="jaxcalib-") as folder:
        additional = [str(copy_without_outputs(file, Path(folder))) for file in configuration.additional_files]
        question = {
            "arguments": _arguments(configuration, additional),
            "trips": [[*trip[:2], list(trip[2]), trip[3]] for trip in trips_without_edges(files)],
        }
        done = subprocess.run(
            [sys.executable, "-m", "sim_adapters.sumo.loading_worker"],
            input=json.dumps(question), capture_output=True, text=True, timeout=LONGEST_LOADING_S, check=False,
            env=os.environ | {"LIBSUMO_AS_TRACI": "quiet"},
        )  # fmt: skip
    lines = [line.strip() for line in (done.stderr + done.stdout).splitlines()]
    answer = next((line.removeprefix(ANSWER) for line in reversed(lines) if line.startswith(ANSWER)), None)
    if answer is None:
        errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
        words = " ".join(errors[:MOST_LINES]) or " ".join(lines[-3:]) or f"its process ended with {done.returncode}"
        raise ScenarioError(configuration.file, f"SUMO refuses the scenario: {words}")
    said = json.loads(answer)
    warnings = tuple(dict.fromkeys(line for line in lines if line.startswith("Warning: ")))
    trips = ((origin, destination, tuple(via), vtype) for origin, destination, via, vtype in question["trips"])
    ways = {trip: tuple(edges) for trip, edges in zip(trips, said["ways"], strict=True) if edges}
    return LoadedScenario(said["vtypes"], ways, warnings[:MOST_LINES])


ANSWER = "jaxcalib answer: "


def _arguments(configuration: SumoConfiguration, additional: Sequence[str]) -> list[str]:
    arguments = ["--net-file", str(configuration.net_file)]
    arguments += ["--route-files", ",".join(map(str, configuration.route_files)), "--route-steps", "0"]
    arguments += ["--additional-files", ",".join(additional)] if additional else []
    arguments += ["--begin", str(configuration.begin_s), "--step-length", str(configuration.step_s)]
    skipped = {"route-steps"}
    for option, value in configuration.processing.items():
        if option not in skipped:
            arguments += [f"--{option}", value]
    return [*arguments, "--no-step-log", "true", "--duration-log.disable", "true"]
