"""Forms in which users' files say things: they are read as SUMO drives them, and what is written SUMO drives."""

import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.finding import Level
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.scenario.scenario_writer import WrittenScenario, write_scenario
from sim_adapters.sumo.loading import load_in_sumo
from surrogate.effects.base import EffectSetting
from tests.places import CORRIDOR

ROUTE = '<route id="R" edges="in0 m0 m1"/>'
CAR = '<vType id="car" carFollowModel="IDM" tau="1.1"/>'
EGO = '<vehicle id="ego" route="R" depart="40" departSpeed="max"/>'
FLOW = '<flow id="f" type="car" route="R" vehsPerHour="720"/>'
DURATION_S = 120.0


@dataclass(frozen=True)
class Made:
    """A scenario made of some files."""

    folder: Path

    def read(self, **options) -> Scenario:
        return read_scenario(self.folder / "user.sumocfg", "ego", DURATION_S, load_in_sumo, **options)


@pytest.fixture
def make(tmp_path: Path) -> Callable[..., Made]:
    """Return a function that writes a scenario on the corridor's road from the contents of its route files."""

    def made(*routes: str, additional: str = "", options: str = "", network: Callable[[str], str] = str) -> Made:
        folder = tmp_path / "user"
        folder.mkdir()
        net = (CORRIDOR / "scenario/net.net.xml").read_text()
        (folder / "net.net.xml").write_text(network(net))
        names = [f"{number}.rou.xml" for number in range(len(routes))]
        for name, text in zip(names, routes, strict=True):
            (folder / name).write_text(f"<routes>{text}</routes>")
        inputs = f'<net-file value="net.net.xml"/><route-files value="{",".join(names)}"/>'
        if additional:
            (folder / "more.add.xml").write_text(f"<additional>{additional}</additional>")
            inputs += '<additional-files value="more.add.xml"/>'
        (folder / "user.sumocfg").write_text(
            f'<configuration><input>{inputs}</input><time><step-length value="0.5"/></time>{options}</configuration>'
        )
        return Made(folder)

    return made


@pytest.fixture
def drive(tmp_path: Path, start_sumo: Callable[..., subprocess.Popen]) -> Callable[..., list[ET.Element]]:
    """Return a function that lets plain SUMO run a configuration and returns who departed."""

    def driven(config: Path, end_s: float = DURATION_S) -> list[ET.Element]:
        out = tmp_path / "departed.xml"
        more = ("--vehroute-output", out, "--vehroute-output.write-unfinished", "true")
        assert start_sumo(end_s, "ego", None, "-c", config, *more).wait(60.0) == 0
        return [one for one in ET.parse(out).getroot() if one.tag == "vehicle"]

    return driven


def layout_of(flow: str, *attributes: str, vtypes: Sequence[str] = ("car",)) -> ParameterLayout:
    return ParameterLayout(("one",), ((flow,),), tuple(vtypes), attributes)


def write(scenario: Scenario, layout: ParameterLayout, folder: Path, *more: float, factor: float = 1.0, **options):
    folder.mkdir()
    rate_vehph = 3600.0 * scenario.mean_rate_vehps(layout.input_flows[0][0])
    values = (factor * rate_vehph, *more)
    return write_scenario(scenario, layout, values, options.pop("depart_s", 40.0), "ego", folder, **options)


def elements(written: WrittenScenario, tag: str) -> list[ET.Element]:
    return [one for file in written.files for one in ET.parse(file).getroot().iter(tag)]


def singles(number: int, **attributes: str) -> str:
    more = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return "".join(f'<vehicle id="v{k}" depart="{k}" departSpeed="max" {more}/>' for k in range(number))


@pytest.mark.parametrize("way", ["route in another file", "a distribution of routes"])
def test_single_vehicles_are_scaled_wherever_their_route_stands(way: str, make, drive, tmp_path: Path):
    mix = '<routeDistribution id="ways"><route id="S" edges="in0 m0 m1" probability="1"/></routeDistribution>'
    route = {"route in another file": "R", "a distribution of routes": "ways"}[way]
    scenario = make(CAR + ROUTE + mix, EGO + singles(40, type="car", route=route)).read()
    written = write(scenario, layout_of("vehicles of in0"), tmp_path / "half", factor=0.5)
    departed = drive(written.config)
    assert len(departed) == 21
    assert "ego" in {one.get("id") for one in departed}


def test_single_vehicles_of_a_mix_are_dealt_its_members(make):
    mix = '<vTypeDistribution id="mix"><vType id="car" probability="3"/><vType id="lorry" vClass="truck" length="12" '
    mix += 'probability="1"/></vTypeDistribution>'
    scenario = make(mix + ROUTE, EGO + singles(40, type="mix", route="R")).read()
    vtypes = [vehicle.vtype for vehicle in scenario.demand.vehicles]
    assert Counter(vtypes) == {"car": 30, "lorry": 10}
    assert vtypes[:8].count("lorry") == 2  # not one after the other
    assert {flow.vtype for flow in scenario.flows} == {"car", "lorry"}


def test_a_subject_vehicle_of_a_mix_is_refused(make):
    mix = '<vTypeDistribution id="mix"><vType id="car"/><vType id="lorry"/></vTypeDistribution>'
    with pytest.raises(ScenarioError, match="'ego': expected one vType and one route"):
        make(mix + ROUTE + EGO.replace("route=", 'type="mix" route=') + singles(3, type="car", route="R")).read()


@pytest.mark.parametrize(("end", "over_s"), [("", 86_400.0), ('<end value="3600"/>', 3600.0)])
def test_a_number_of_vehicles_comes_until_the_end_that_sumo_takes(end: str, over_s: float, make, drive, tmp_path: Path):
    number = round(over_s / 4.0)
    flow = f'<flow id="f" type="car" route="R" begin="0" number="{number}"/>'
    scenario = make(CAR + ROUTE + flow + EGO, options=f"<time>{end}</time>").read(windows={"f": (0.0, 60.0)})
    assert [part.rate_vehps for part in scenario.flows] == pytest.approx([0.25, 0.25])
    layout = ParameterLayout(("a", "b"), (("f@0",), ("f@60",)), ("car",), ())
    (tmp_path / "w").mkdir()
    written = write_scenario(scenario, layout, (900.0, 1800.0), 40.0, "ego", tmp_path / "w")
    departed = Counter(one.get("id", "").split(".")[0] for one in drive(written.config))
    assert departed == {"ego": 1, "f@0": 15, "f@60": pytest.approx(30, abs=1)}


def test_ways_of_a_mix_are_found(make):
    mix = '<vTypeDistribution id="mix"><vType id="car"/><vType id="lorry" vClass="truck"/></vTypeDistribution>'
    flow = '<flow id="f" type="mix" from="in0" to="m1" vehsPerHour="720"/>'
    scenario = make(mix + ROUTE + flow + EGO).read()
    assert {part.vtype: part.route for part in scenario.flows} == dict.fromkeys(("car", "lorry"), ("in0", "m0", "m1"))


@pytest.mark.parametrize("scale", [0.5, 0.7, 2.0, 3.0])
def test_each_subject_vehicle_is_there_once_however_demand_is_scaled(scale: float, make, drive, tmp_path: Path):
    before = '<vehicle id="first" type="car" route="R" depart="1"/>'
    subject = EGO.replace("route=", 'type="car" route=')
    scenario = make(CAR + ROUTE + FLOW + before + subject, options=f'<scale value="{scale}"/>').read()
    assert scenario.mean_rate_vehps("f") == pytest.approx(0.2 * scale)
    written = write(scenario, layout_of("f", "tau"), tmp_path / "w", 2.2, depart_s=(40.0, 60.0, 80.0))
    departed = Counter(one.get("id", "") for one in drive(written.config))
    assert {name: count for name, count in departed.items() if name.startswith("ego")} == {
        "ego": 1, "ego.subject1": 1, "ego.subject2": 1,
    }  # fmt: skip
    assert sum(name.startswith("f.") for name in departed) == pytest.approx(24 * scale, abs=1)
    taus = {one.get("id"): one.get("tau") for one in elements(written, "vType")}
    assert taus == {"car": "2.2", "car.unscaled": "2.2"}


def test_values_reach_a_model_in_an_element_of_its_own(make, tmp_path: Path):
    nested = '<vType id="car" minGap="2.1"><carFollowing-IDM tau="1.3" accel="2.0"/></vType>'
    scenario = make(nested + ROUTE + FLOW + EGO).read()
    values = scenario.values_of("car")
    assert (scenario.model_of("car"), values["tau"], values["accel"], values["minGap"]) == ("IDM", 1.3, 2.0, 2.1)
    written = write(scenario, layout_of("f", "tau"), tmp_path / "w", 2.2)
    (vtype,) = elements(written, "vType")
    assert len(vtype) == 0
    assert {name: vtype.get(name) for name in ("carFollowModel", "tau", "accel")} == {
        "carFollowModel": "IDM", "tau": "2.2", "accel": "2.0",
    }  # fmt: skip


def test_flows_within_an_interval_are_traffic(make, drive, tmp_path: Path):
    flows = f'<interval begin="20" end="60">{FLOW}</interval>'
    scenario = make(CAR + ROUTE + EGO + flows).read()
    (flow,) = scenario.flows
    assert (flow.begin_s, flow.end_s, flow.rate_vehps) == (20.0, 60.0, 0.2)
    written = write(scenario, layout_of("f"), tmp_path / "w", factor=2.0)
    departs_s = [float(one.get("depart", "")) for one in drive(written.config) if one.get("id") != "ego"]
    assert len(departs_s) == 16
    assert 20.0 <= min(departs_s) < max(departs_s) < 65.0


def test_vtypes_bring_their_shares_into_a_mix_that_names_them(make):
    vtypes = '<vType id="car" probability="0.9"/><vType id="lorry" vClass="truck" probability="0.1"/>'
    mix = '<vTypeDistribution id="mix" vTypes="car lorry"/>'
    flow = FLOW.replace('type="car"', 'type="mix"')
    scenario = make(vtypes + mix + ROUTE + flow + EGO).read()
    assert {part.vtype: part.rate_vehps for part in scenario.flows} == pytest.approx({"car": 0.18, "lorry": 0.02})


def test_a_deviation_of_its_own_counts_beside_a_distribution(make, tmp_path: Path):
    vtype = '<vType id="car" speedFactor="normc(1.1,0.2,0.2,2)" speedDev="0.01"/>'
    scenario = make(vtype + ROUTE + FLOW + EGO).read()
    values = scenario.values_of("car")
    assert (values["speedFactor"], values["speedDev"]) == (1.1, 0.01)
    written = write(scenario, layout_of("f", "speedDev"), tmp_path / "w", 0.07)
    (vtype,) = elements(written, "vType")
    assert (vtype.get("speedFactor"), vtype.get("speedDev")) == ("normc(1.1,0.07,0.2,2)", "0.07")


MIXES = {
    "within": '<vTypeDistribution id="mix"><vType id="car" tau="1.1" probability="0.7"/><vType id="lorry" '
    'vClass="truck" tau="1.4" probability="0.3"/></vTypeDistribution>',
    "named": '<vType id="car" tau="1.1"/><vType id="lorry" vClass="truck" tau="1.4"/><vTypeDistribution id="mix" '
    'vTypes="car lorry" probabilities="0.7 0.3"/>',
}


@pytest.mark.parametrize("mix", MIXES)
@pytest.mark.parametrize("name", ["reaction_delay", "heavy_vehicles", "driver_heterogeneity", "acceleration_noise"])
def test_effects_reach_the_members_of_a_mix(name: str, mix: str, make, drive, tmp_path: Path):
    flows = FLOW.replace('type="car"', 'type="mix"') + FLOW.replace('"f"', '"g"')
    scenario = make(MIXES[mix] + ROUTE + flows + EGO).read()
    written = write(scenario, layout_of("f"), tmp_path / "w", effects={name: EffectSetting(0.5)}, seed=3)
    vtypes = {one.get("id", ""): one for one in elements(written, "vType")}
    departed = [one.get("type", "") for one in drive(written.config) if one.get("id", "") != "ego"]
    assert len(departed) == pytest.approx(48, abs=2)
    if name == "reaction_delay":
        assert {one.get("actionStepLength") for one in vtypes.values()} == {"0.5"}
    elif name == "acceleration_noise":
        assert all(one.find("param") is not None for one in vtypes.values())
    else:
        members = {"heavy_vehicles": 2, "driver_heterogeneity": 40}[name]
        parts = [one for one in vtypes if "-" in one]
        assert len(parts) == len(vtypes) == 2 * members
        assert set(departed) <= set(parts)
        lorries = sum(one.startswith("lorry") for one in departed) / len(departed)
        assert 0.02 < lorries < 0.35  # three tenths of the flow that has any


def test_effects_reach_drivers_without_a_vtype(make, tmp_path: Path):
    scenario = make(ROUTE + FLOW.replace('type="car"', "") + EGO).read()
    layout = layout_of("f", vtypes=("DEFAULT_VEHTYPE",))
    written = write(scenario, layout, tmp_path / "w", effects={"reaction_delay": EffectSetting(1.0)})
    assert [one.get("actionStepLength") for one in elements(written, "vType")] == ["1"]


def test_what_is_not_read_is_named(make):
    def network(text: str) -> str:
        limit = '<type id="slow"><restriction vClass="truck" speed="15"/></type>'
        text = text.replace('<edge id="m0" ', f'{limit}<edge id="m0" type="slow" ', 1)
        return text.replace('<lane id="m1_0" ', '<lane id="m1_0" changeLeft="authority" ', 1)

    lorry = '<vType id="lorry" vClass="truck"/>'
    stop = (
        '<vehicle id="broken" type="lorry" route="R" depart="5"><stop lane="m0_0" endPos="50" duration="20"/></vehicle>'
    )
    flow = FLOW.replace("vehsPerHour", 'speedFactor="0.6" arrivalPos="max" vehsPerHour')
    scenario = make(CAR + lorry + ROUTE + stop + flow + EGO, network=network).read()
    told = {(one.element, one.words.partition(":")[0]) for one in scenario.findings if one.level is Level.APPROXIMATED}
    assert {
        ("<restriction> of vClass 'truck'", "a limit of its own"),
        ("attribute 'changeLeft' of <lane>", "the surrogate does without; SUMO runs with it"),
        ("vehicle 'broken'", "<stop>"),
        ("flow 'f'", "speedFactor"),
    } <= told
    assert not any("arrivalPos" in one.words for one in scenario.findings)


def test_what_acts_on_traffic_keeps_what_it_acts_by(make, drive, tmp_path: Path):
    additional = (
        '<routeProbe id="probe" edge="m0" freq="60" file="probed.xml"/><calibrator id="c" edge="m0" pos="0" freq="60" '
        'routeProbe="probe"><flow begin="0" end="60" speed="20"/></calibrator>'
        '<inductionLoop id="idle" lane="m0_0" pos="20" freq="60" file="counted.xml"/>'
        '<variableSpeedSign id="s" lanes="m1_0" file="speeds.xml"/>'
    )
    made = make(CAR + ROUTE + FLOW + EGO, additional=additional, options='<weight-files value="weights.xml"/>')
    (made.folder / "speeds.xml").write_text('<vss><step time="0" speed="10"/></vss>')
    (made.folder / "weights.xml").write_text("<meandata/>")
    scenario = made.read()
    run = write(scenario, layout_of("f"), tmp_path / "run")
    assert {one.get("id") for one in elements(run, "routeProbe")} == {"probe"}
    assert not elements(run, "inductionLoop")
    assert len(drive(run.config)) > 20
    handed_over = write(scenario, layout_of("f"), tmp_path / "handed over", is_handed_over=True)
    shutil.rmtree(made.folder)  # it stands alone
    assert len(drive(handed_over.config)) > 20
    assert {one.get("file") for one in elements(handed_over, "variableSpeedSign")} == {"speeds.xml"}
    assert not (tmp_path / "run/probed.xml").exists()
