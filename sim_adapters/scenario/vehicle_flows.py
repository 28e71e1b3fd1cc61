"""Single vehicles as flows: for the surrogate, and for inputs that scale what enters at an edge."""

from collections import Counter
from collections.abc import Iterable

from sim_adapters.scenario.demand_file import Flow, Vehicle, vehicles_id

WINDOW_S = 60.0  # in which vehicles are counted


def flows_of_vehicles(vehicles: Iterable[Vehicle], begin_s: float, end_s: float, scale: float = 1.0) -> list[Flow]:
    """Flows at which as many vehicles of each kind come in each window as the single ones.

    Args:
        vehicles: the single ones.
        begin_s: begin of the simulation.
        end_s: its end.
        scale: SUMO's factor on all demand.
    """
    counts: Counter[tuple] = Counter()
    for vehicle in vehicles:
        window = int((vehicle.depart_s - begin_s) / WINDOW_S)
        counts[(window, vehicle.route[0], vehicle.vtype, vehicle.route, vehicle.departure)] += 1
    flows = []
    for (window, edge, vtype, route, departure), number in sorted(counts.items(), key=str):
        first_s = begin_s + window * WINDOW_S
        last_s = min(first_s + WINDOW_S, end_s)
        rate = scale * number / (last_s - first_s)
        flows.append(Flow(vehicles_id(edge), vtype, route, rate, False, first_s, last_s, departure))
    return flows
