"""One run of SUMO before anything else: does the subject vehicle enter and arrive, and who waits outside?

It goes on beside other work, and ends when its time is over, wherever it is then.
"""

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.sumo.question import refusal, start_worker

AS_IT_IS = ParameterLayout(input_ids=(), input_flows=(), vtypes=(), attributes=())
SPARE_S = 60.0  # for starting, loading and ending, however busy the machine is


class Said(TypedDict):
    """What the worker says; see `FirstRun`."""

    reached_s: float
    is_whole: bool
    entered_s: float | None
    arrived_s: float | None
    edge: str
    waiting: list[str]  # ids of the vehicles


@dataclass(frozen=True)
class FirstRun:
    """What a first run showed."""

    reached_s: float  # where it ended, on the scenario's clock
    is_whole: bool  # whether it ended by itself, not because its time was over
    entered_s: float | None  # when the subject vehicle entered; None where it did not
    arrived_s: float | None  # when it arrived; None where it did not
    edge: str = ""  # where it was at the end; empty where it was not on the road
    # how many vehicles of each entrance's edge had not entered by the end
    waiting: Mapping[str, int] = field(default_factory=dict)


def start_first_run(
    scenario: Scenario, subject_vehicle: str, depart_s: float, end_s: float, longest_s: float
) -> Callable[[], FirstRun]:
    """Start a run in the background.

    Args:
        scenario: what to run.
        subject_vehicle: id of the subject vehicle.
        depart_s: when it departs.
        end_s: when the run ends at the latest, on the scenario's clock.
        longest_s: how long it may compute.

    Returns:
        What waits for it, and raises a ScenarioError in SUMO's words where SUMO ends it.
    """
    folder = tempfile.TemporaryDirectory(prefix="jaxcalib-")
    written = write_scenario(scenario, AS_IT_IS, (), depart_s, subject_vehicle, Path(folder.name))
    question = {
        "arguments": ["-c", str(written.config), "--no-step-log", "true", "--duration-log.disable", "true"],
        "subject": subject_vehicle,
        "end_s": end_s,
        "longest_s": longest_s,
    }
    wait = start_worker("sim_adapters.sumo.first_run_worker", question, longest_s + SPARE_S, Said)

    def finish() -> FirstRun:
        with folder:
            said, lines = wait()
        if said is None:
            raise ScenarioError(scenario.configuration.file, f"SUMO ends a run of the scenario: {refusal(lines)}")
        edge_of = {flow.id: flow.route[0] for flow in scenario.demand.flows}
        edge_of |= {vehicle.id: vehicle.route[0] for vehicle in scenario.demand.vehicles}
        edges = (edge_of.get(name) or edge_of.get(name.rpartition(".")[0]) for name in said["waiting"])
        waiting = Counter(edge for edge in edges if edge is not None)
        return FirstRun(
            said["reached_s"], said["is_whole"], said["entered_s"], said["arrived_s"], said["edge"], waiting
        )

    return finish
