"""What SUMO says of a scenario that it has loaded."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sim_adapters.scenario.demand_definitions import Route

Trip = tuple[str, str, Route, str]  # from, to, via, vType


@dataclass(frozen=True)
class LoadedScenario:
    """What SUMO says of a scenario.

    Attributes:
        vtypes: numeric attributes of each vType by SUMO's attribute names, defaults of its class included.
        ways: edges of each trip whose edges only SUMO's router knows; absent where there is no way.
        warnings: SUMO's own, one line each.
    """

    vtypes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    ways: Mapping[Trip, Route] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def find_route(self, origin: str, destination: str, via: Route, vtype: str) -> Route | None:
        """Edges of a trip; None where there is no way."""
        return self.ways.get((origin, destination, via, vtype))
