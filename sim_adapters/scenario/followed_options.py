"""Which options and vType attributes of SUMO the surrogate follows, and what those cost that it does without."""

from collections.abc import Sequence

from sim_adapters.scenario.configuration import SumoConfiguration
from sim_adapters.scenario.demand_file import Demand, Flow
from sim_adapters.scenario.finding import WITHOUT, Finding, Level
from sim_adapters.scenario.sumo_names import SUMO_MODELS, nearest_model

# Options that change how vehicles move, and what the surrogate does instead.
APPROXIMATED = {
    "lateral-resolution": "sublane model: the surrogate keeps vehicles in lanes",
    "step-method.ballistic": "ballistic steps: the surrogate takes Euler steps",
    "default.action-step-length": WITHOUT,
    "lanechange.overtake-right": WITHOUT,
    "default.carfollowmodel": WITHOUT,
    "random-depart-offset": WITHOUT,
    "max-depart-delay": "the surrogate has vehicles wait to enter for as long as it takes",
    "max-num-vehicles": WITHOUT,
    "insertion-checks": WITHOUT,
    "emergency-insert": WITHOUT,
    "extrapolate-departpos": WITHOUT,
    "device.rerouting.probability": WITHOUT,
    "device.driverstate.probability": WITHOUT,
}
USUAL = {"insertion-checks": "all"}
# Ways to depart, and what the surrogate does instead.
APPROXIMATED_DEPARTURES = (
    ("position", "free", "departPos 'free': the surrogate tries the edge's begin alone, not gaps further on"),
    ("position", "random_free", "departPos 'random_free': the surrogate tries ten places and the edge's begin alone"),
)
LANE_CHANGE_MODELS = ("LC2013", "default")


def option_findings(configuration: SumoConfiguration) -> list[Finding]:
    """Findings on the configuration's options."""
    file = configuration.file.name
    return [
        Finding(Level.APPROXIMATED, file, f"option '{option}'", words)
        for option, words in APPROXIMATED.items()
        if configuration.is_on(option) and configuration.processing[option] != USUAL.get(option)
    ]


def vtype_findings(demand: Demand, vtypes: Sequence[str]) -> list[Finding]:
    """Findings on the vTypes that drive."""
    findings, file = [], demand.file.name
    for name in vtypes:
        attributes = demand.vtypes[name]
        model, lane_change = attributes.get("carFollowModel"), attributes.get("laneChangeModel", "LC2013")
        element = f"vType '{name}'"
        if model is not None and model not in SUMO_MODELS:
            words = f"carFollowModel {model}: the surrogate takes {nearest_model(model)}"
            findings.append(Finding(Level.APPROXIMATED, file, element, words))
        if lane_change not in LANE_CHANGE_MODELS:
            words = f"laneChangeModel {lane_change}: the surrogate takes LC2013"
            findings.append(Finding(Level.APPROXIMATED, file, element, words))
        if "actionStepLength" in attributes:
            findings.append(Finding(Level.APPROXIMATED, file, element, f"actionStepLength: {WITHOUT}"))
    return findings


def flow_findings(demand: Demand, flows: Sequence[Flow]) -> list[Finding]:
    """Findings on how background vehicles come."""
    findings, file = [], demand.file.name
    for attribute, value, words in APPROXIMATED_DEPARTURES:
        named = list(dict.fromkeys(flow.id for flow in flows if getattr(flow.departure, attribute) == value))
        if named:
            findings.append(Finding(Level.APPROXIMATED, file, f"flow '{named[0]}'", words, len(named)))
    return findings
