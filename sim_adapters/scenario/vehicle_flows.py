"""Single vehicles as flows: for the surrogate, and for inputs that scale what enters at an edge."""

from collections import Counter
from collections.abc import Iterable

from sim_adapters.scenario.demand_file import Flow, Vehicle, vehicles_id
from sim_adapters.scenario.demand_windows import Windows, id_at

WINDOW_S = 60.0  # in which vehicles are counted


def flows_of_vehicles(
    vehicles: Iterable[Vehicle], begin_s: float, end_s: float, scale: float, windows: Windows
) -> list[Flow]:
    """Flows at which as many vehicles of each kind come in each window as the single ones.

    Args:
        vehicles: the single ones.
        begin_s: begin of the simulation.
        end_s: its end.
        scale: SUMO's factor on all demand.
        windows: windows of time in which they are counted apart, by the flow's name.
    """
    counts: Counter[tuple] = Counter()
    for vehicle in vehicles:
        window = int((vehicle.depart_s - begin_s) / WINDOW_S)
        name = id_at(vehicles_id(vehicle.route[0]), windows, vehicle.depart_s)
        counts[(window, name, vehicle.vtype, vehicle.route, vehicle.departure)] += 1
    flows = []
    for (window, name, vtype, route, departure), number in sorted(counts.items(), key=str):
        first_s = begin_s + window * WINDOW_S
        last_s = min(first_s + WINDOW_S, end_s)
        rate = scale * number / (last_s - first_s)
        flows.append(Flow(name, vtype, route, rate, False, first_s, last_s, departure))
    return flows
