"""Which lanes of the carriageway end before the road, where, and which of them lead off."""

from pathlib import Path

import pytest

from jaxcalib.measures.observed_road import observe_road
from sim_adapters.scenario.ending_lanes import ending_lanes
from tests.sim_adapters.scenario.test_road_findings import read_with

NO_EXIT = '<connection from="m6" to="off1" fromLane="0" toLane="0" via=":n7_0_0" dir="s" state="M"/>'


def test_acceleration_and_exit_lanes_end_where_their_edges_do(own_corridor: Path):
    scenario = read_with(own_corridor)
    network = scenario.network
    merge, exit_lane = ending_lanes(scenario.row_map)
    assert (merge.row, exit_lane.row) == tuple(scenario.row_map.row_of_lane[key] for key in (("m3", 0), ("m6", 0)))
    assert (merge.begin_m, merge.end_m) == (network.edge_start_m("m3"), network.edge_end_m("m3"))
    assert (exit_lane.begin_m, exit_lane.end_m) == (network.edge_start_m("m6"), network.edge_end_m("m6"))
    assert (merge.leads_off, exit_lane.leads_off) == (False, True)


def test_measures_know_them(own_corridor: Path):
    scenario = read_with(own_corridor)
    ending = observe_road(scenario).ending
    assert ending.end_m.tolist() == pytest.approx([one.end_m for one in ending_lanes(scenario.row_map)])
    assert ending.leads_off.tolist() == [0.0, 1.0]
