"""Lanes that meet or part within a junction: where the surrogate's vehicles change lane, and towards which side."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.scenario.change_zones import LEFT, RIGHT, ZONE_M
from sim_adapters.scenario.finding import Level
from sim_adapters.scenario.road_builder import build_road
from sim_adapters.scenario.scenario import Scenario
from tests.sim_adapters.scenario.test_road_findings import read_with

EXIT = '<connection from="m6" to="off1" fromLane="0" toLane="0" via=":n7_0_0" dir="s" state="M"/>'
THROUGH = '<connection from="m6" to="m7" fromLane="1" toLane="0" via=":n7_1_0" dir="s" state="M"/>'
ON_RAMP = '<connection from="on1" to="m3" fromLane="0" toLane="0" via=":n3_0_0" dir="s" state="M"/>'


@pytest.fixture
def forked(own_corridor: Path) -> Scenario:
    """The lane of the exit is gone: its neighbour leads both on and off."""
    return read_with(own_corridor, (EXIT, EXIT.replace('fromLane="0"', 'fromLane="1"')))


@pytest.fixture
def merging(own_corridor: Path) -> Scenario:
    """The on-ramp leads into the lane that the right lane of the carriageway goes on in."""
    return read_with(own_corridor, (ON_RAMP, ON_RAMP.replace('toLane="0"', 'toLane="1"')))


def test_a_lane_that_forks_has_the_exit_beside_it_behind_the_fork(forked: Scenario):
    (zone,) = forked.network.zones
    fork_m = forked.network.edge_start_m("off1")
    assert (zone.lane, zone.beside, zone.side, zone.is_merge) == (("m7", 0), ("off1", 0), RIGHT, False)
    assert (zone.begin_m, zone.end_m) == pytest.approx((fork_m, fork_m + ZONE_M))
    (finding,) = forked.findings
    assert (finding.level, finding.element) == (Level.APPROXIMATED, "lane 'm6_1'")
    assert "'off1_0'" in finding.words


def test_only_those_who_leave_there_must_change(forked: Scenario):
    road = build_road(forked.row_map, forked.destination_routes)
    (zone,) = forked.network.zones
    row, exit_row = (forked.row_map.row_of_lane[key] for key in (zone.lane, zone.beside))
    within, behind = (int(road.segment_at(jnp.asarray(at_m))) for at_m in (zone.begin_m + 50.0, zone.end_m + 1.0))
    assert int(road.right_row[row, within]) == exit_row
    assert int(road.right_row[row, behind]) == -1
    leaves = np.asarray([route[-1] == "off1" for route in forked.destination_routes])
    offset, stop_m = (np.asarray(table)[:, row, within] for table in (road.best_lane_offset, road.stop_position_m))
    assert leaves.sum() == 1
    np.testing.assert_array_equal(offset[leaves], [-1])
    np.testing.assert_allclose(stop_m[leaves], zone.end_m, atol=0.1)
    np.testing.assert_array_equal(offset[~leaves], 0)
    assert np.isinf(stop_m[~leaves]).all()


def test_an_on_ramp_that_leads_into_the_carriageway_s_lane_lies_beside_it_before(merging: Scenario):
    (zone,) = merging.network.zones
    end_m = merging.network.edge_end_m("on1")
    assert (zone.lane, zone.side, zone.is_merge) == (("on1", 0), LEFT, True)
    assert zone.beside[0] == "m2"
    assert (zone.begin_m, zone.end_m) == pytest.approx((end_m - ZONE_M, end_m))
    assert merging.network.lanes[("on1", 0)].successors == ()
    road = build_road(merging.row_map, merging.destination_routes)
    row, beside = (merging.row_map.row_of_lane[key] for key in (zone.lane, zone.beside))
    before, within = (int(road.segment_at(jnp.asarray(at_m))) for at_m in (zone.begin_m - 1.0, zone.end_m - 1.0))
    assert (int(road.left_row[row, before]), int(road.left_row[row, within])) == (-1, beside)
    assert int(road.right_row[beside, within]) == -1  # nobody changes onto the ramp
    assert (np.asarray(road.best_lane_offset)[:, row, within] >= 1).all()
    assert (np.asarray(road.stop_position_m)[:, row, within] <= zone.end_m).all()


def test_lanes_of_one_edge_that_meet_are_beside_one_another_already(own_corridor: Path):
    meeting = THROUGH.replace('fromLane="1" toLane="0"', 'fromLane="1" toLane="1"')
    scenario = read_with(own_corridor, (THROUGH, meeting))
    network = scenario.network
    assert network.zones == ()
    assert network.lanes[("m6", 1)].successors == ()
    assert network.lanes[("m6", 2)].successors == (("m7", 1),)
    (finding,) = [one for one in scenario.findings if "lead into" in one.words]
    assert finding.level is Level.APPROXIMATED
    assert "'m6_1'" in finding.words
