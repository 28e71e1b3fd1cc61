"""What can be said of a case in seconds: how well the surrogate can follow it, what is odd, and all that is wrong."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxcalib.case.case import Case, ScenarioParts, read_case, require_scenario
from jaxcalib.errors import CaseError
from jaxcalib.field.covered_parts import coverage_warnings, recorded_parts
from jaxcalib.field.drive_logs import DriveLogs, judge_without_road, read_drives, table_faults
from jaxcalib.problem.drive_warnings import departure_warnings, one_sided_warnings
from jaxcalib.problem.inputs import read_scenario_of
from jaxcalib.problem.parameter_layout import layout_of
from jaxcalib.problem.problem import frame_interval_s
from jaxcalib.problem.problem_checks import (
    clock_faults,
    drive_faults,
    input_faults,
    model_faults,
)
from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.demand_file import Flow
from sim_adapters.scenario.finding import Finding, Level, sorted_findings
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.sumo.first_run import FirstRun, start_first_run

FIRST_RUN_S = 1.5  # computing time of SUMO's first run; what it does not reach shows in the runs before a search
WORTH_SAYING = 0.05  # share of an entrance's vehicles that wait outside
FEW_WAIT = 5  # vehicles wait for a gap where nothing is too much


@dataclass(frozen=True)
class CaseCheck:
    """What can be said of a case in seconds."""

    name: str  # the case's name
    # ids of its inputs, with the flows of each; found in the scenario where the case names none
    inputs: dict[str, tuple[str, ...]]
    findings: tuple[Finding, ...]  # parts of the scenario, those that the surrogate cannot follow first
    warnings: tuple[str, ...]  # what a user should know of scenario and logs, one line each
    refusals: tuple[str, ...] = ()  # what is wrong, one line each; with any, nothing else can be done with the case
    first_run: FirstRun | None = None  # what a run of SUMO showed; None where there could be none
    groups: tuple[tuple[str, ...], ...] = ()  # of vTypes with driver parameters of their own; none where all share them
    has_scenario: bool = True  # otherwise nothing but the logs was judged
    case: Case | None = None  # what case.toml says
    logs: DriveLogs | None = None  # what was read of its drives; None where the scenario could not be read

    @property
    def is_left_to_sumo(self) -> bool:
        """Whether a search has to run in SUMO alone."""
        return any(finding.level is Level.SUMO_ALONE for finding in self.findings)

    @property
    def lines_before(self) -> tuple[str, ...]:
        """What was understood of the scenario, to be said before the warnings."""
        follows = f"The surrogate follows every part of the scenario of {self.name}."
        return (
            *([follows] if self.has_scenario and not self.findings and not self.refusals else []),
            *(f"input {name}: {len(flows)} flows" for name, flows in self.inputs.items()),
            *(f"vTypes {', '.join(group)}: driver parameters of their own" for group in self.groups),
        )

    @property
    def lines_after(self) -> tuple[str, ...]:
        """What is to be expected, to be said after the warnings."""
        lines = [] if self.first_run is None else [_run_line(self.first_run)]
        where = "SUMO alone" if self.is_left_to_sumo else "the surrogate, and is confirmed in SUMO"
        if not self.has_scenario:
            lines.append(
                "The case has no scenario: its logs were judged by themselves. Give [scenario] to calibrate it."
            )
        elif not self.refusals:
            lines.append(f"A calibration searches in {where}.")
        return tuple(lines)


def _run_line(run: FirstRun) -> str:
    if run.entered_s is None:
        did = "has not entered"
    elif run.arrived_s is None:
        did = f"enters at {run.entered_s:g} s and is under way"
    else:
        return f"In a run of SUMO the subject vehicle enters at {run.entered_s:g} s and arrives at {run.arrived_s:g} s."
    short = "" if run.is_whole else "; a check gives SUMO a moment only, and judges no further"
    return f"In a run of SUMO the subject vehicle {did} at {run.reached_s:g} s{short}."


def check_case(folder: Path | str, *, first_run_s: float = FIRST_RUN_S) -> CaseCheck:
    """Read a case, have SUMO load its scenario and begin a run, and lay its logs onto the road.

    Args:
        folder: the case's folder.
        first_run_s: how long SUMO's run may compute.

    Raises:
        CaseError: case.toml cannot be read; one line says what.
    """
    case = read_case(folder)
    if case.scenario is None and case.subject is None and case.behaviour is None:
        logs = judge_without_road(case)
        warnings, refusals = (*logs.left_out, *logs.contradictions), tuple(map(str, logs.refusals))
        return CaseCheck(case.name, {}, (), warnings, refusals, has_scenario=False, case=case, logs=logs)
    parts = require_scenario(case)
    try:
        scenario, parts = read_scenario_of(parts)
    except ScenarioError as error:
        faults = [*(CaseError(one.file, "", one.message) for one in (error, *error.others)), *table_faults(case)]
        return CaseCheck(case.name, {}, (), (), tuple(map(str, faults)), case=case)
    faults = [*model_faults(scenario, parts), *input_faults(scenario, parts)]
    groups: tuple[tuple[str, ...], ...] = ()
    try:
        groups = layout_of(parts, scenario).groups
    except CaseError as error:
        faults.append(error)
    of_clock = clock_faults(scenario, parts, case)
    first_depart_s = min(drive.depart_s for drive in case.drives)
    wait = None
    if not of_clock:
        vehicle, end_s = parts.subject.vehicle, parts.scenario.duration_s
        wait = start_first_run(scenario, vehicle, first_depart_s, end_s, first_run_s)
    logs = read_drives(case, scenario.row_map)
    recorded = recorded_parts(logs.case.drives, logs.drives, scenario)
    interval_s = frame_interval_s(scenario.configuration.step_s)
    is_seen = [bool(np.any(drive.on_clock(interval_s).valid)) for drive in logs.drives]
    faults += [*of_clock, *logs.refusals, *drive_faults(logs.case, logs.drives, is_seen, interval_s)]
    refusals, first_run = [str(fault) for fault in faults], None
    if wait is not None:
        try:
            first_run = wait()
        except ScenarioError as error:
            refusals.append(str(CaseError(error.file, "", error.message)))
    if first_run is not None and first_run.is_whole and first_run.entered_s is None:
        refusals.append(_never_entered(scenario, parts, first_depart_s))
    return CaseCheck(
        name=case.name,
        inputs={entrance.id: entrance.flows for entrance in parts.inputs},
        findings=tuple(sorted_findings(scenario.findings)),
        warnings=(
            *scenario.warnings,
            *logs.left_out,
            *logs.contradictions,
            *departure_warnings(case, logs.drives),
            *one_sided_warnings(case, logs.drives),
            *coverage_warnings(recorded, logs.drives, scenario.network.length_m),
            *(line for drive in logs.drives for line in drive.warnings),
            *(_run_warnings(scenario, parts, first_run) if first_run else ()),
        ),
        refusals=tuple(refusals),
        first_run=first_run,
        groups=groups,
        case=case,
        logs=logs,
    )


def _never_entered(scenario: Scenario, parts: ScenarioParts, depart_s: float) -> str:
    """Say that the subject vehicle stays outside."""
    demand, edge = scenario.demand, scenario.demand.subject_route[0]
    vclass = demand.vtypes[demand.subject_vtype].get("vClass", "passenger")
    if _is_closed(scenario, edge, vclass):
        why = f"no lane of that edge is open to its vClass '{vclass}' (allow and disallow in the network)."
    else:
        why = "change its departLane, departPos or departSpeed, or what enters before it."
    expected = (
        f"expected vehicle '{parts.subject.vehicle}' to enter; in a run of SUMO it waits before edge '{edge}' from "
        f"{depart_s:g} s to the end: {why}"
    )
    return str(CaseError(demand.file, "", expected))


def _is_closed(scenario: Scenario, edge: str, vclass: str) -> bool:
    """Whether no lane of an edge is open to a vehicle class."""
    return not any(lane.allows(vclass) for lane in scenario.network.net.getEdge(edge).getLanes())


def _run_warnings(scenario: Scenario, parts: ScenarioParts, run: FirstRun) -> list[str]:
    """What a user should know of SUMO's first run."""
    lines, demand = [], scenario.demand
    if run.is_whole and run.entered_s is not None and run.arrived_s is None:
        where = f"at the end it is on edge '{run.edge}'" if run.edge else "it is taken from the road on the way"
        lines.append(
            f"{demand.file.name}: vehicle '{parts.subject.vehicle}' enters at {run.entered_s:g} s and does not arrive "
            f"by {run.reached_s:g} s in a run of SUMO; {where}. Raise scenario.duration_s, or mend what holds it, if "
            "its drive should be whole."
        )
    for edge, waiting in run.waiting.items():
        flows = [flow for flow in scenario.demand.flows if flow.route[0] == edge]
        asked = max(waiting, _asked(flows, scenario.configuration.begin_s, run.reached_s))
        if waiting <= max(WORTH_SAYING * asked, FEW_WAIT):
            continue
        closed = {vclass for vclass in _vclasses(scenario, flows) if _is_closed(scenario, edge, vclass)}
        if closed:
            why = f"no lane of that edge is open to {', '.join(sorted(closed))} (allow and disallow in the network)."
        else:
            why = "more than its lanes take in. Inflows beyond that change nothing, and cannot be found."
        lines.append(
            f"{demand.file_at(edge).name}: flows from edge '{edge}': at {run.reached_s:g} s in a run of SUMO {waiting} "
            f"vehicles wait outside, of about {asked:.0f} that were to enter: {why}"
        )
    return lines


def _vclasses(scenario: Scenario, flows: Sequence[Flow]) -> set[str]:
    return {scenario.demand.vtypes[flow.vtype].get("vClass", "passenger") for flow in flows}


def _asked(flows: Sequence[Flow], begin_s: float, now_s: float) -> float:
    """Vehicles that flows have brought by now, on average."""
    return sum(flow.rate_vehps * max(0.0, min(flow.end_s, now_s) - max(flow.begin_s, begin_s)) for flow in flows)
