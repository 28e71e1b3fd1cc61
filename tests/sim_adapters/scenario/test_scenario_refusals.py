"""A scenario from a stranger may be wrong, it may not do harm: one line says which file and what was expected."""

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario import sumo_files
from sim_adapters.scenario.finding import Level
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.scenario.sumo_names import attribute_values
from sim_adapters.world.world_builder import build_template

CONFIG, DEMAND, NET = "scenario.sumocfg", "demand.rou.xml", "net.net.xml"
DOCTYPE = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'


def read(case: Path) -> Scenario:
    return read_scenario(case / "scenario" / CONFIG, "ego", 720.0)


def spoil(case: Path, name: str, old: str, new: str) -> None:
    file = case / "scenario" / name
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def refusal(case: Path, name: str) -> str:
    """Return what is said, which must be one line that names the file."""
    with pytest.raises(ScenarioError) as error:
        read(case)
    line = str(error.value)
    assert line.startswith(f"{name}: ")
    assert "\n" not in line
    return line


@pytest.mark.parametrize("said", [None, {"length": float("nan")}])
@pytest.mark.parametrize("text", ["nan", "inf", "long"])
def test_a_vtype_has_finite_numbers(text: str, said: Mapping[str, float] | None):
    with pytest.raises(ValueError, match=f"attribute 'length': expected a number, got '{text}'"):
        attribute_values({"length": text}, "IDM", said)
    assert attribute_values({"length": text}, "IDM", {"length": 4.5})["length"] == 4.5  # what SUMO makes of it


def test_the_copy_is_read_before_it_is_spoilt(own_corridor: Path):
    assert read(own_corridor).warnings == ()


@pytest.mark.parametrize(
    ("name", "root"), [(CONFIG, "<configuration>"), (DEMAND, "<routes>"), (NET, "<net ")], ids=[CONFIG, DEMAND, NET]
)
def test_document_types(own_corridor: Path, name: str, root: str):
    spoil(own_corridor, name, root, DOCTYPE + root)
    assert "DOCTYPE" in refusal(own_corridor, name)


def test_document_types_in_packed_files(own_corridor: Path):
    packed = own_corridor / "scenario/demand.rou.xml.gz"
    packed.write_bytes(gzip.compress((DOCTYPE + (own_corridor / "scenario" / DEMAND).read_text()).encode()))
    spoil(own_corridor, CONFIG, f'"{DEMAND}"', f'"{packed.name}"')
    assert "DOCTYPE" in refusal(own_corridor, packed.name)


def test_document_types_in_another_encoding(own_corridor: Path):
    file = own_corridor / "scenario" / DEMAND
    file.write_bytes(("<?xml version='1.0' encoding='UTF-16'?>" + DOCTYPE + file.read_text()).encode("utf-16"))
    refusal(own_corridor, DEMAND)


@pytest.mark.parametrize("name", [DEMAND, NET])
def test_elements_within_elements_end_somewhere(own_corridor: Path, name: str):
    root = "<routes>" if name == DEMAND else "<net "
    text = (own_corridor / "scenario" / name).read_text()
    end = text.rindex("</")
    (own_corridor / "scenario" / name).write_text(f"{text[:end]}{'<a>' * 5000}{'</a>' * 5000}{text[end:]}")
    assert root in text
    assert "100 levels" in refusal(own_corridor, name)


@pytest.mark.parametrize("encoding", ["none", "rot13", "hex"])
def test_encodings_that_are_none(own_corridor: Path, encoding: str):
    file = own_corridor / "scenario" / DEMAND
    file.write_text(f'<?xml version="1.0" encoding="{encoding}"?>' + file.read_text())
    assert "expected XML" in refusal(own_corridor, DEMAND)


def test_packed_files_that_are_cut_off(own_corridor: Path):
    packed = own_corridor / "scenario/demand.rou.xml.gz"
    packed.write_bytes(gzip.compress((own_corridor / "scenario" / DEMAND).read_bytes())[:200])
    spoil(own_corridor, CONFIG, f'"{DEMAND}"', f'"{packed.name}"')
    assert "can be read" in refusal(own_corridor, packed.name)


def test_packed_files_are_read_up_to_a_limit(own_corridor: Path, monkeypatch: pytest.MonkeyPatch):
    packed = own_corridor / "scenario/demand.rou.xml.gz"
    packed.write_bytes(gzip.compress((own_corridor / "scenario" / DEMAND).read_bytes()))
    spoil(own_corridor, CONFIG, f'"{DEMAND}"', f'"{packed.name}"')
    assert len(read(own_corridor).flows) == 4
    packed.write_bytes(gzip.compress(b"<routes>" + b" " * 4_000_000 + b"</routes>"))
    monkeypatch.setattr(sumo_files, "LARGEST_UNPACKED_BYTES", 3 * 2**20)
    with pytest.raises(ScenarioError, match=r"^demand\.rou\.xml\.gz: expected at most 3 MiB"):
        read_xml(packed)


def test_options_that_would_write_files_or_open_sockets_are_left_out(
    own_corridor: Path, layout: ParameterLayout, tmp_path: Path
):
    harm = (
        f'<output><fcd-output value="{tmp_path}/harm.xml"/></output><traci_server><remote-port value="9999"/>'
        "</traci_server><default.speeddev value='0.07'/>"
    )
    spoil(own_corridor, CONFIG, "<time>", harm + "<time>")
    spoil(own_corridor, CONFIG, "<processing>", '<processing><device.rerouting.output value="x"/>')
    scenario = read(own_corridor)
    for part in ("'fcd-output'", "'remote-port'", "'device.rerouting.output'"):
        (line,) = (line for line in scenario.warnings if part in line)
        assert line.startswith(f"{CONFIG}: ")
        assert "\n" not in line
    out = tmp_path / "out"
    out.mkdir()
    written = write_scenario(scenario, layout, (1000.0, 100.0, 1.0, 2.5, 2.6, 1.0, 0.1, 1.0, 1.0), 5.0, "ego", out)
    root = ET.parse(written.config).getroot()
    assert [section.tag for section in root] == ["input", "time", "processing"]
    assert [option.tag for option in root[0]] == ["net-file", "route-files"]
    # what acts on traffic is kept, in whichever section it stood, or in none
    assert {option.tag for option in root[2]} == {"time-to-teleport", "collision.action", "default.speeddev"}
    assert "harm" not in written.config.read_text()


@pytest.mark.parametrize("is_absolute", [True, False])
def test_files_may_lie_anywhere(own_corridor: Path, tmp_path: Path, is_absolute: bool):
    elsewhere = own_corridor.parent / "elsewhere"
    elsewhere.mkdir()
    for name in (NET, DEMAND):
        (own_corridor / "scenario" / name).rename(elsewhere / name)
        spoil(own_corridor, CONFIG, f'"{name}"', f'"{elsewhere if is_absolute else "../../elsewhere"}/{name}"')
    configuration = read(own_corridor).configuration
    assert configuration.net_file == (elsewhere / NET).resolve()
    assert configuration.route_files == ((elsewhere / DEMAND).resolve(),)


@pytest.mark.parametrize(
    ("name", "old", "new", "expected"),
    [
        (CONFIG, f'"{DEMAND}"', '"nothing.rou.xml"', None),
        (CONFIG, f'<route-files value="{DEMAND}"/>', "", "route-files"),
        (CONFIG, f'"{NET}"', f'"{NET},{NET}"', "one network"),
        (CONFIG, 'step-length value="0.1"', 'step-length value="fast"', "'step-length'"),
        (CONFIG, 'begin value="0"', 'begin value="-3"', "'begin'"),
        (CONFIG, "</configuration>", "", "expected XML"),
        (DEMAND, "</routes>", "", "expected XML"),
        (DEMAND, 'id="f_main_e" type="car"', 'id="f_main_e" type="lorry"', "'lorry'"),
        (DEMAND, 'id="ego" type="subject"', 'id="ego" type="robot"', "'robot'"),
        (DEMAND, 'id="ego"', 'id="other"', "'ego'"),
        (DEMAND, 'route="r_main_e"', 'route="r_nowhere"', "'r_nowhere'"),
        (DEMAND, 'edges="in1 on1 m3 m4 m5 m6 off1"', 'edges="in1 on1 m3 m4 m55"', "flow 'f_on1_o1'"),
        (DEMAND, 'edges="in1 on1 m3 m4 m5 m6 off1"', 'edges="in1 m4 m5 m6 off1"', "from edge 'in1' to 'm4'"),
        (DEMAND, 'tau="1.0"', 'tau="long"', "'tau'"),
        (DEMAND, 'period="exp(0.130000)"', 'period="exp(often)"', "period"),
        (DEMAND, 'period="exp(0.130000)"', "", "expected period"),
        (DEMAND, "<route id", '<vTypeDistribution id="mix" vTypes="lorry"/><route id', "'mix'"),
        (DEMAND, 'route="r_main_e"', 'from="in0" to="m6"', "finds none"),
    ],
)
def test_what_is_wrong_is_named(own_corridor: Path, name: str, old: str, new: str, expected: str | None):
    spoil(own_corridor, name, old, new)
    # a path that leads nowhere is said of the file that is not there
    named = "nothing.rou.xml" if new == '"nothing.rou.xml"' else name
    line = refusal(own_corridor, named)
    assert expected is None or expected in line


@pytest.mark.parametrize(
    ("name", "old", "new", "level", "part"),
    [
        (CONFIG, 'collision.action value="warn"', 'lateral-resolution value="0.8"', Level.APPROXIMATED, "sublane"),
        (DEMAND, 'carFollowModel="IDM"', 'carFollowModel="EIDM"', Level.APPROXIMATED, "takes IDM"),
        (CONFIG, 'collision.action value="warn"', 'max-depart-delay value="60"', Level.APPROXIMATED, "as long as"),
        (DEMAND, 'departPos="last"', 'departPos="free"', Level.APPROXIMATED, "departPos 'free'"),
        (DEMAND, "<route id", '<inductionLoop id="loop" file="../harm.xml"/><route id', Level.BESIDE, "inductionLoop"),
        (DEMAND, "<route id", '<rerouter id="r" edges="m4"/><route id', Level.APPROXIMATED, "rerouter"),
    ],
)  # fmt: skip
def test_what_the_surrogate_cannot_follow_is_said(
    own_corridor: Path, name: str, old: str, new: str, level: Level, part: str
):
    spoil(own_corridor, name, old, new)
    (finding,) = read(own_corridor).findings
    assert finding.level is level
    assert str(finding).startswith(f"{name}: ")
    assert part in str(finding)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('departSpeed="avg"', 'departSpeed="max"'),
        ('departLane="best" departPos="last" departSpeed="avg"', 'departLane="1" departPos="-7.5" departSpeed="12"'),
        ('begin="0" end="720" period="exp(0.130000)"', 'begin="9" end="720" period="exp(0.13)"'),
        ("<vehicle ", '<vehicle id="one" type="car" route="r_main_e" depart="0:02:03" departLane="best"/><vehicle '),
    ],
)
def test_there_is_nothing_to_say_of_what_is_followed(own_corridor: Path, old: str, new: str):
    spoil(own_corridor, DEMAND, old, new)
    assert read(own_corridor).findings == ()


def test_a_departure_of_which_the_file_says_nothing_is_sumo_s_and_followed(own_corridor: Path):
    """SUMO 1.28's `default.departlane` and `default.departspeed`; it was the first lane and standing before."""
    spoil(own_corridor, DEMAND, 'departLane="best" departPos="last" departSpeed="avg"', "")
    scenario = read(own_corridor)
    assert scenario.findings == ()
    silent = [flow.departure for flow in scenario.flows if flow.departure.position == "base"]
    assert {(departure.lane, departure.speed) for departure in silent} == {("best_prob", "avg")}


def test_a_number_that_is_no_number(own_corridor: Path):
    spoil(own_corridor, DEMAND, 'depart="300"', 'depart="nan"')
    assert "depart" in refusal(own_corridor, DEMAND)


def test_an_input_with_a_flow_that_is_not_there(corridor: Scenario, layout: ParameterLayout):
    wrong = replace(layout, input_flows=(("f_main_o1", "f_main_x"), layout.input_flows[1]))
    with pytest.raises(ScenarioError) as error:
        build_template(corridor, wrong)
    assert str(error.value) == f"{DEMAND}: input 'main': expected a <flow id='f_main_x'>; there is none."


def test_a_vehicle_type_that_is_not_there(corridor: Scenario, layout: ParameterLayout):
    with pytest.raises(ScenarioError) as error:
        build_template(corridor, replace(layout, vtypes=("car", "lorry")))
    assert str(error.value) == f"{DEMAND}: expected a <vType id='lorry'>; there is none."
