"""What Stage 1 calibrates: the case's inputs, by window of time where it asks for that, or one for each entrance."""

import dataclasses

from jaxcalib.case.case import Input, ScenarioParts
from sim_adapters.scenario.demand_windows import Windows, parts_in_windows, window_id
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.sumo.loading import load_in_sumo


def read_scenario_of(parts: ScenarioParts) -> tuple[Scenario, ScenarioParts]:
    """Read a case's scenario; also return the parts of the case with every input there.

    Raises:
        ScenarioError: SUMO refuses the scenario, or something is missing.
    """
    windows = {flow: entrance.windows_s for entrance in parts.inputs if entrance.windows_s for flow in entrance.flows}
    scenario = read_scenario(
        parts.scenario.config_file, parts.subject.vehicle, parts.scenario.duration_s, load_in_sumo, windows
    )
    inputs = inputs_by_window(parts.inputs, scenario, windows) or found_inputs(scenario)
    return scenario, dataclasses.replace(parts, inputs=inputs)


def found_inputs(scenario: Scenario) -> tuple[Input, ...]:
    """One input for each edge at which background traffic enters, named by that edge."""
    flows = {edge: [flow for flow in scenario.flows if flow.route[0] == edge] for edge in scenario.entrances}
    return tuple(
        Input(edge, tuple(dict.fromkeys(flow.id for flow in coming)))
        for edge, coming in flows.items()
        if sum(flow.rate_vehps for flow in coming) > 0.0
    )


def inputs_by_window(inputs: tuple[Input, ...], scenario: Scenario, windows: Windows) -> tuple[Input, ...]:
    """The inputs, each with windows of time replaced by one for each window in which its flows come.

    An input whose flows the scenario lacks stays as it is, for the checks to name them.
    """
    parts: list[Input] = []
    for entrance in inputs:
        there = [parts_in_windows(flow, windows, scenario.flow_ids) for flow in entrance.flows]
        if not entrance.windows_s or not all(there):
            parts.append(entrance)
            continue
        for begin_s in entrance.windows_s:
            wanted = {window_id(flow, begin_s) for flow in entrance.flows}
            flows = tuple(part for of_flow in there for part in of_flow if part in wanted)
            if flows:
                parts.append(Input(window_id(entrance.id, begin_s), flows))
    return tuple(parts)
