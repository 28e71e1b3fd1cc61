"""What is drawn is a road as asked, netconvert makes it, and SUMO's lanes lead where its routes go."""

import numpy as np
import pytest
import sumolib
from hypothesis import given
from hypothesis import strategies as st

from experiments.roads.drawn_road import drawn_roads, find_road
from experiments.roads.road_plan import DEMAND_SHARES, LEAST_MAIN_VEHPH, draw_plan, lane_capacity_vehph

SEEDS = st.integers(0, 10**6)


@given(SEEDS)
def test_a_plan_is_within_what_is_asked(seed: int) -> None:
    plan = draw_plan(seed)
    assert plan == draw_plan(seed)
    ramps = [ramp for section in plan.sections for ramp in (section.on_ramp, section.off_ramp) if ramp]
    assert 1 <= len(ramps) <= 3
    assert len(plan.ramp_lengths_m) == len(ramps)
    assert 2 <= plan.lanes <= 4
    assert min(section.lanes - section.auxiliary for section in plan.sections) >= 2
    assert DEMAND_SHARES[0] <= plan.demand_share <= DEMAND_SHARES[1]


@given(SEEDS)
def test_the_most_loaded_section_has_the_load_that_was_drawn(seed: int) -> None:
    plan = draw_plan(seed)
    capacity_vehph = lane_capacity_vehph(plan.limit_kmh)
    flow, loads = plan.inputs_vehph["main"], []
    for section in plan.sections:
        flow += plan.inputs_vehph.get(section.on_ramp or "", 0.0)
        loads.append(flow / (capacity_vehph * (section.lanes - section.auxiliary)))
        flow *= 1.0 - plan.exit_shares.get(section.off_ramp or "", 0.0)
    if plan.inputs_vehph["main"] > LEAST_MAIN_VEHPH:
        assert max(loads) == pytest.approx(plan.demand_share, abs=0.01)  # inflows are rounded


@given(st.floats(60.0, 140.0))
def test_capacity_is_less_than_time_gaps_alone_would_let_through(limit_kmh: float) -> None:
    """One vehicle per time gap is the bound; what passes where all drive at 0.8 of what they want is no more."""
    desired_mps = 0.97 * limit_kmh / 3.6
    at_mps = 0.8 * desired_mps
    passing_vehph = 3600.0 * at_mps / ((2.0 + 1.1 * at_mps) / (1.0 - 0.8**4) ** 0.5 + 4.8)
    assert passing_vehph <= lane_capacity_vehph(limit_kmh) * 1.001 < 3600.0 / 1.1


@pytest.mark.parametrize("seed", range(8))
def test_every_route_leads_through_and_no_lane_is_lost(seed: int) -> None:
    pytest.importorskip("sumo", reason="netconvert is not installed")
    plan, road = draw_plan(seed), find_road(f"drawn-{seed}")
    net = sumolib.net.readNet(str(road.net_file))
    for flow in road.flows:
        for one, other in zip(flow.edges, flow.edges[1:], strict=False):
            assert net.getEdge(other) in net.getEdge(one).getOutgoing()
    for section, name, following in zip(plan.sections, road.ego_edges, road.ego_edges[1:], strict=False):
        edge = net.getEdge(name)
        assert edge.getLaneNumber() == section.lanes
        through = {link.getFromLane().getIndex() for link in edge.getOutgoing()[net.getEdge(following)]}
        lost = section.lanes - len(through)
        assert lost == (section.auxiliary or section.kind == "drop")
    by_entrance = {name: sum(f.share for f in road.flows if f.entrance == name) for name in road.inputs_vehph}
    np.testing.assert_allclose(list(by_entrance.values()), 1.0)


def test_ramps_lie_on_the_right() -> None:
    pytest.importorskip("sumo", reason="netconvert is not installed")
    road = find_road("drawn-1")  # two on-ramps and an off-ramp
    net = sumolib.net.readNet(str(road.net_file))
    for name in ("on1", "on2", "off1"):
        ramp = net.getEdge(name)
        node = ramp.getToNode() if name.startswith("on") else ramp.getFromNode()
        far = ramp.getFromNode() if name.startswith("on") else ramp.getToNode()
        main = next(edge for edge in node.getIncoming() if edge is not ramp)
        (x0, y0), (x1, y1) = main.getFromNode().getCoord(), main.getToNode().getCoord()
        x, y = np.subtract(far.getCoord(), node.getCoord())
        assert (x1 - x0) * y - (y1 - y0) * x < 0.0


@pytest.mark.parametrize(("name", "said"), [("elsewhere", "drawn-SEED"), ("drawn-x", "drawn-SEED")])
def test_an_unknown_road_is_refused(name: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        find_road(name)


def test_drawn_roads_are_their_seed_s_and_have_on_ramps() -> None:
    names = drawn_roads(12, 99)
    assert names == drawn_roads(12, 99) != drawn_roads(12, 100)
    assert len(set(names)) == 12
    plans = [draw_plan(int(name.removeprefix("drawn-"))) for name in names]
    assert all(any(section.on_ramp for section in plan.sections) for plan in plans)
