"""A scenario writes nothing but what jaxcalib asks for, however it asks to."""

import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import sumolib

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.configuration import LEFT_OUT, read_configuration
from sim_adapters.scenario.option_names import SYNONYMS
from sim_adapters.scenario.scenario_files import copy_without_outputs
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.sumo.loading import load_in_sumo

DETECTOR = '<inductionLoop id="loop" lane="in0_0" pos="20" freq="60" file="{harm}"/>'
WRITERS = {
    "detector": DETECTOR,
    "detector within another element": f"<unknown>{DETECTOR}</unknown>",
    "calibrator": '<calibrator id="c" edge="in0" pos="0" freq="60" output="{harm}"/>',
    "conflicts of a vType": '<vType id="watched"><param key="has.ssm.device" value="true"/>'
    '<param key="device.ssm.file" value="{harm}"/></vType>',
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("file", ["harmful.rou.xml", "harmful.add.xml"])
def test_nothing_that_writes_is_left_in_a_copy(tmp_path: Path, name: str, file: str):
    harmful = tmp_path / file
    harmful.write_text(f'<additional><vType id="car" tau="1.1"/>{WRITERS[name].format(harm="/harm.xml")}</additional>')
    folder = tmp_path / "copies"
    folder.mkdir()
    copy = copy_without_outputs(harmful, folder)
    assert copy.parent == folder
    text = copy.read_text()
    assert "harm.xml" not in text
    assert "ssm" not in text
    assert 'tau="1.1"' in text


def test_what_acts_on_traffic_is_kept(tmp_path: Path):
    kept = tmp_path / "acting.add.xml"
    kept.write_text(
        '<additional><variableSpeedSign id="s" lanes="in0_0" file="speeds.xml"/><rerouter id="r" edges="in0" '
        'file="ways.xml"/><vType id="car"><param key="device.toc.responseTime" value="2"/></vType></additional>'
    )
    assert copy_without_outputs(kept, tmp_path) == kept


def test_an_include_is_refused(tmp_path: Path):
    file = tmp_path / "more.rou.xml"
    file.write_text('<routes><unknown><include href="/etc/other.xml"/></unknown></routes>')
    with pytest.raises(ScenarioError, match=r"^more\.rou\.xml: expected no <include>"):
        read_xml(file)


@pytest.mark.parametrize(
    "option", ["ndump", "netstate", "vehroutes", "person-fcd", "l", "C", "pedestrian.jupedsim.wkt"]
)
def test_options_are_known_by_all_their_names(own_corridor: Path, option: str):
    file = own_corridor / "scenario/scenario.sumocfg"
    file.write_text(file.read_text().replace("<time>", f'<output><{option} value="/harm.xml"/></output><time>'))
    configuration = read_configuration(file)
    assert "/harm.xml" not in configuration.processing.values()


@pytest.mark.long
def test_sumo_writes_nothing_while_it_looks_at_a_scenario(own_corridor: Path, tmp_path: Path):
    harm = tmp_path / "harm.xml"
    demand = own_corridor / "scenario/demand.rou.xml"
    harmful = "".join(WRITERS[name] for name in WRITERS).replace("{harm}", str(harm))
    demand.write_text(demand.read_text().replace("</routes>", f"{harmful}</routes>"))
    file = own_corridor / "scenario/scenario.sumocfg"
    file.write_text(file.read_text().replace("<time>", f'<output><ndump value="{harm}"/></output><time>'))
    assert "car" in load_in_sumo(read_configuration(file)).vtypes
    assert not harm.exists()


def test_the_names_are_sumo_s_and_all_that_writes_is_left_out(tmp_path: Path):
    template, program = tmp_path / "template.sumocfg", sumolib.checkBinary("sumo")
    if shutil.which(program) is None:
        pytest.skip("eclipse-sumo is not installed")
    subprocess.run([program, "--save-template", template], check=True, capture_output=True)
    options = [option for section in ET.parse(template).getroot() for option in section]
    names = {other: one.tag for one in options for other in one.get("synonymes", "").split()}
    assert {other: name for other, name in SYNONYMS.items() if other != "route"} == names
    reads = ("net-file", "route-files", "additional-files", "weight-files", "astar", "phemlight-path")
    writes = [one.tag for one in options if one.get("type") == "FILE" and not one.tag.startswith(reads)]
    assert len(writes) > 40
    assert [name for name in writes if not LEFT_OUT.search(name)] == []
