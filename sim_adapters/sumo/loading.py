"""Lets SUMO load a scenario and say what it made of it: vTypes with all defaults, ways of trips, or why it refuses."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.configuration import SumoConfiguration
from sim_adapters.scenario.demand_file import trips_without_edges
from sim_adapters.scenario.loaded_scenario import LoadedScenario
from sim_adapters.scenario.scenario_files import copy_without_outputs, names_in_use
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.sumo.question import MOST_LINES, refusal, start_worker

LONGEST_LOADING_S = 300.0


class Loaded(TypedDict):
    """What the worker says."""

    vtypes: dict[str, dict[str, float]]  # attributes by vType
    ways: list[list[str]]  # edges of each trip without


def load_in_sumo(configuration: SumoConfiguration) -> LoadedScenario:
    """Load a scenario in SUMO.

    Args:
        configuration: what to load.

    Raises:
        ScenarioError: SUMO refuses; in its own words.
    """
    files = [*configuration.additional_files, *configuration.route_files]
    in_use = names_in_use(read_xml(file) for file in files)
    with tempfile.TemporaryDirectory(prefix="jaxcalib-") as folder:
        additional, routes = (
            [str(copy_without_outputs(file, Path(folder), in_use)) for file in several]
            for several in (configuration.additional_files, configuration.route_files)
        )
        question = {
            "arguments": _arguments(configuration, additional, routes),
            "trips": [[*trip[:2], list(trip[2]), trip[3]] for trip in trips_without_edges(files)],
        }
        said, lines = start_worker("sim_adapters.sumo.loading_worker", question, LONGEST_LOADING_S, Loaded)()
    if said is None:
        raise ScenarioError(configuration.file, f"SUMO refuses the scenario: {refusal(lines)}")
    warnings = tuple(dict.fromkeys(line for line in lines if line.startswith("Warning: ")))
    trips = ((origin, destination, tuple(via), vtype) for origin, destination, via, vtype in question["trips"])
    ways = {trip: tuple(edges) for trip, edges in zip(trips, said["ways"], strict=True) if edges}
    return LoadedScenario(said["vtypes"], ways, warnings[:MOST_LINES])


def _arguments(configuration: SumoConfiguration, additional: Sequence[str], routes: Sequence[str]) -> list[str]:
    arguments = ["--net-file", str(configuration.net_file)]
    arguments += ["--route-files", ",".join(routes), "--route-steps", "0"]
    arguments += ["--additional-files", ",".join(additional)] if additional else []
    arguments += ["--begin", str(configuration.begin_s), "--step-length", str(configuration.step_s)]
    if configuration.end_s is not None and configuration.end_s > configuration.begin_s:  # else told by who reads it
        arguments += ["--end", str(configuration.end_s)]
    skipped = {"route-steps"}
    for option, value in configuration.processing.items():
        if option not in skipped:
            arguments += [f"--{option}", value]
    return [*arguments, "--no-step-log", "true", "--duration-log.disable", "true"]
