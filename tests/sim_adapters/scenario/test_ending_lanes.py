"""Which lanes of the carriageway end before the road, where, and which of them lead off."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.measures.observed_road import EndingRows, observe_road
from sim_adapters.scenario.ending_lanes import ending_lanes
from tests.sim_adapters.scenario.test_road_findings import read_with

WIDENS = '<connection from="m5" to="m6" fromLane="0" toLane="1" via=":n6_0_0" dir="s" state="M"/>'


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


@pytest.mark.parametrize("exit_first", [True, False])
def test_where_a_lane_widens_the_exit_begins_there(own_corridor: Path, exit_first: bool):
    """The right lane of m5 leads both into the exit's lane and on: who is on it has yet to choose."""
    into_exit = WIDENS.replace('toLane="1"', 'toLane="0"')
    scenario = read_with(own_corridor, (WIDENS, into_exit + WIDENS if exit_first else WIDENS + into_exit))
    network = scenario.network
    (exit_lane,) = (one for one in ending_lanes(scenario.row_map) if one.leads_off)
    assert (exit_lane.begin_m, exit_lane.end_m) == (network.edge_start_m("m6"), network.edge_end_m("m6"))


def test_a_road_whose_lanes_all_go_on_has_none(own_corridor: Path):
    """Measures of such a road know of no end."""
    ending = observe_road(read_with(own_corridor)).ending
    nothing = EndingRows(*(leaf[:0] for leaf in (ending.row, ending.begin_m, ending.end_m, ending.leads_off)))
    assert np.isinf(nothing.end_m_at(jnp.asarray([0.0, 3.0]), jnp.asarray([100.0, 1500.0]))).all()
