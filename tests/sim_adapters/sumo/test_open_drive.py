"""The road that netconvert writes as ASAM OpenDRIVE lies where SUMO's lanes lie."""

import itertools
import subprocess
from pathlib import Path

import numpy as np
import pytest
import sumolib
from scipy.spatial import KDTree

from sim_adapters.errors import ScenarioError
from sim_adapters.sumo.open_drive import write_open_drive
from tests.places import CORRIDOR, ROOT
from tests.sim_adapters.sumo.open_drive_lanes import SAMPLE_M, lane_middles_m

pytest.importorskip("sumo", reason="netconvert is not installed")

TWO_LANE = ROOT / "experiments/roads/two_lane"
LANE_WIDTH_M = 3.75
CURVES_M = 0.2  # netconvert lays curves where a lane's shape has corners


def left_hand_road(folder: Path) -> Path:
    network, plain = folder / "left.net.xml", TWO_LANE / "plain"
    command = [
        sumolib.checkBinary("netconvert"), "-n", f"{plain}.nod.xml", "-e", f"{plain}.edg.xml", "-x", f"{plain}.con.xml",
        "--lefthand", "--proj.utm", "-o", str(network),
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True)
    return network


def apart_m(network: Path, road: Path, *, internal: bool) -> float:
    """The farthest that a place on a lane of SUMO is from the middle of a lane of the road."""
    tree = KDTree(lane_middles_m(road))
    farthest_m = 0.0
    for edge in sumolib.net.readNet(str(network), withInternal=True).getEdges(withInternal=True):
        for lane in edge.getLanes() if (edge.getFunction() == "internal") == internal else []:
            shape = np.asarray([point[:2] for point in lane.getShape()])
            between = np.linspace(0.0, 1.0, 20)[:, None]
            places = np.concatenate([begin + between * (end - begin) for begin, end in itertools.pairwise(shape)])
            farthest_m = max(farthest_m, float(tree.query(places)[0].max()))
    return farthest_m


@pytest.mark.parametrize("name", ["corridor", "two_lane", "left_hand"])
def test_lanes_lie_where_those_of_sumo_lie(tmp_path: Path, name: str):
    networks = {"corridor": CORRIDOR / "scenario/net.net.xml", "two_lane": TWO_LANE / "net.net.xml"}
    network, road = networks.get(name) or left_hand_road(tmp_path), tmp_path / "road.xodr"
    assert write_open_drive(network, road)
    assert apart_m(network, road, internal=False) < 0.5 * SAMPLE_M + CURVES_M
    assert apart_m(network, road, internal=True) < LANE_WIDTH_M  # junctions are drawn anew
    head = road.read_text()[:2000]
    assert 'revMinor="5"' in head


def test_what_netconvert_cannot_read_is_refused_in_its_words(tmp_path: Path):
    network = tmp_path / "net.net.xml"
    network.write_text("nothing\n")
    with pytest.raises(ScenarioError, match=r"net\.net\.xml: netconvert makes no OpenDRIVE of it: invalid document"):
        write_open_drive(network, tmp_path / "road.xodr")


def test_without_netconvert_there_is_no_road(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sumolib, "checkBinary", lambda name: f"{tmp_path}/{name}")
    assert not write_open_drive(CORRIDOR / "scenario/net.net.xml", tmp_path / "road.xodr")
    assert not (tmp_path / "road.xodr").exists()
