"""What can be said of a case before any simulation: how well the surrogate can follow it, and what is odd."""

from dataclasses import dataclass
from pathlib import Path

from jaxcalib.case.case import read_case, require_scenario
from jaxcalib.errors import CaseError
from jaxcalib.field.field_log import read_drives
from jaxcalib.problem.problem import found_inputs
from jaxcalib.problem.problem_checks import check_clock, check_models, coverage_warnings
from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.scenario import read_scenario
from sim_adapters.sumo.loading import load_in_sumo


@dataclass(frozen=True)
class CaseCheck:
    """What can be said of a case before any simulation.

    Attributes:
        name: the case's name.
        inputs: ids of its inputs, with the flows of each; found in the scenario where the case names none.
        findings: parts of the scenario, those that the surrogate cannot follow first.
        warnings: what a user should know of scenario and logs, one line each.
    """

    name: str
    inputs: dict[str, tuple[str, ...]]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]

    @property
    def is_left_to_sumo(self) -> bool:
        """Whether a search has to run in SUMO alone."""
        return any(finding.level is Level.SUMO_ALONE for finding in self.findings)


def check_case(folder: Path | str) -> CaseCheck:
    """Read a case, have SUMO load its scenario, and lay its logs onto the road.

    Raises:
        CaseError: SUMO refuses the scenario, or the case or its logs are wrong; one line says what.
    """
    case = read_case(folder)
    parts = require_scenario(case)
    try:
        scenario = read_scenario(
            parts.scenario.config_file, parts.subject.vehicle, parts.scenario.duration_s, load_in_sumo
        )
        check_models(scenario, parts)
        check_clock(scenario, parts, case)
        drives = read_drives(case, scenario.row_map)
    except ScenarioError as error:
        raise CaseError(error.file, "", error.message) from None
    order = (Level.SUMO_ALONE, Level.APPROXIMATED, Level.BESIDE, Level.FOLLOWED)
    return CaseCheck(
        name=case.name,
        inputs={entrance.id: entrance.flows for entrance in parts.inputs or found_inputs(scenario)},
        findings=tuple(sorted(scenario.findings, key=lambda finding: order.index(finding.level))),
        warnings=(
            *scenario.warnings,
            *coverage_warnings(drives, scenario.network.length_m),
            *(line for drive in drives for line in drive.warnings),
        ),
    )
