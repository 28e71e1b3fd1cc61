"""Which vTypes can be those of vehicles beyond the subject vehicle's sensors; see `surrogate/loop/distant.py`."""

from collections.abc import Mapping

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.scenario import Scenario


def check_distant_vtypes(scenario: Scenario, distant_vtypes: Mapping[str, str]) -> None:
    """Check that vehicles of some vTypes can follow as others beyond the sensors' range.

    Args:
        scenario: road and traffic.
        distant_vtypes: vType as which each of these vTypes follows there.

    Raises:
        ScenarioError: one line says why they cannot.
    """
    of_flows = {flow.vtype for flow in scenario.flows}
    file, known = scenario.demand.file, scenario.demand.vtypes
    for near, distant in distant_vtypes.items():
        if near not in of_flows:
            raise ScenarioError(file, f"distant vehicles: expected a <flow type='{near}'>; there is none.")
        if distant not in known:
            raise ScenarioError(file, f"distant vehicles: expected a <vType id='{distant}'>; there is none.")
        if distant in of_flows or distant == scenario.demand.subject_vtype:
            raise ScenarioError(file, f"distant vehicles: expected a vType that enters nowhere, got '{distant}'.")
        lengths = [scenario.values_of(name)["length"] for name in (near, distant)]
        if lengths[0] != lengths[1]:
            told = f"expected the length of '{near}', {lengths[0]:g}, for '{distant}', got {lengths[1]:g}"
            raise ScenarioError(file, f"distant vehicles: {told}; nobody grows on the road.")
    if len(set(distant_vtypes.values())) < len(distant_vtypes):
        raise ScenarioError(file, "distant vehicles: expected a vType of its own for each; one is named twice.")
