"""What the surrogate cannot follow of a road is said by edge and lane, and closed lanes lead nowhere."""

from pathlib import Path

import pytest

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.best_lanes import best_lanes
from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.scenario import Scenario, read_scenario

ROUTE = ("m5", "m6", "m7", "m8")


def read_with(case: Path, *edits: tuple[str, str]) -> Scenario:
    """Read a copy of the corridor with other text in its network."""
    file = case / "scenario/net.net.xml"
    text = file.read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    file.write_text(text)
    return read_scenario(case / "scenario/scenario.sumocfg", "ego", 720.0)


def closed(lane: str) -> tuple[str, str]:
    index = lane.rpartition("_")[2]
    return f'<lane id="{lane}" index="{index}"', f'<lane id="{lane}" index="{index}" disallow="all"'


def test_a_lane_that_widens_into_two_of_one_edge_is_approximated(own_corridor: Path):
    on = '<connection from="m5" to="m6" fromLane="0" toLane="1" via=":n6_0_0" dir="s" state="M"/>'
    scenario = read_with(own_corridor, (on, on + on.replace('toLane="1"', 'toLane="0"')))
    assert scenario.findings == (
        Finding(
            Level.APPROXIMATED, "net.net.xml", "lane 'm5_0'",
            "widens into 'm6_1' and 'm6_0'; in the surrogate vehicles go on in one of them, and change into the other",
        ),
    )  # fmt: skip


def test_nobody_goes_on_into_a_closed_lane(own_corridor: Path, corridor: Scenario):
    scenario = read_with(own_corridor, closed("m7_2"))
    network = scenario.network
    assert network.lanes[("m6", 3)].successors == ()
    assert network.lanes[("m6", 2)].successors == (("m7", 1),)
    offsets = [outlook.offset for outlook in best_lanes(network, ROUTE)]
    as_it_was = [outlook.offset for outlook in best_lanes(corridor.network, ROUTE)]
    assert as_it_was == [0, 0, 0]
    assert offsets == [0, 0, -1]
    (finding,) = scenario.findings
    assert str(finding) == "net.net.xml: lane 'm7_2': followed; closed to everybody"


def test_a_closed_lane_at_the_entrance_serves_no_route(own_corridor: Path):
    network = read_with(own_corridor, closed("in0_1")).network
    outlooks = best_lanes(network, network.main_edges)
    assert outlooks[1].length_m == 0.0
    assert [outlook.continues for outlook in outlooks] == [True, False, True]


def test_left_hand_traffic_is_told(own_corridor: Path):
    scenario = read_with(own_corridor, ("<net ", '<net lefthand="true" '))
    assert not scenario.network.is_left_hand  # the corridor is drawn for traffic on the right
    (finding,) = scenario.findings
    assert finding.level is Level.FOLLOWED
    assert "left-hand traffic; lanes are drawn from the right" in finding.words


def test_all_routes_that_cannot_be_driven_are_found_at_once(own_corridor: Path):
    demand = own_corridor / "scenario/demand.rou.xml"
    text = demand.read_text()
    for old, new in (("in1 on1 m3 m4 m5 m6 off1", "in1 m3 m4 off1"), ("in1 on1 m3 m4 m5 m6 m7 m8", "in1 on1 m9")):
        assert old in text
        text = text.replace(old, new)
    demand.write_text(text)
    with pytest.raises(ScenarioError) as error:
        read_with(own_corridor)
    lines = [str(one) for one in (error.value, *error.value.others)]
    assert len(lines) == 2
    assert lines[0].startswith(
        "demand.rou.xml: flow 'f_on1_o1': route 'in1 m3 m4 off1': expected a connection from edge"
    )
    assert lines[1].startswith("demand.rou.xml: flow 'f_on1_e': route 'in1 on1 m9': expected edges of the network, got")
