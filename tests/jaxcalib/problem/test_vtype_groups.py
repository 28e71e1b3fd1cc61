"""Which vTypes have driver parameters of their own, on a copy of the corridor with vans and lorries."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from jaxcalib.case.case import read_case, require_scenario
from jaxcalib.errors import CaseError
from jaxcalib.problem.parameter_layout import layout_of
from jaxcalib.problem.problem_checks import vtype_warnings
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario, read_scenario
from tests.places import CORRIDOR

# of flows: f_main_o1 are vans, f_on1_o1 lorries, f_on1_e coaches by nothing but how they are drawn
VTYPES = {
    "van": 'vClass="delivery" tau="1.5"',
    "lorry": 'vClass="truck" tau="2.0" lcCooperative="0"',
    "bus": 'guiShape="bus/coach" tau="2.5"',
    "nobody": 'vClass="trailer"',
}
TYPE_OF_FLOW = {"f_main_o1": "van", "f_on1_o1": "lorry", "f_on1_e": "bus"}

Layout = Callable[..., ParameterLayout]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    copy = Path(shutil.copytree(CORRIDOR, tmp_path / "corridor"))
    demand = copy / "scenario/demand.rou.xml"
    text = demand.read_text()
    more = "".join(f'<vType id="{name}" carFollowModel="IDM" {said}/>' for name, said in VTYPES.items())
    text = text.replace("<vType ", f"{more}<vType ", 1)
    for flow, vtype in TYPE_OF_FLOW.items():
        text, number = re.subn(f'(<flow id="{flow}" type=)"car"', rf'\1"{vtype}"', text)
        assert number == 1
    demand.write_text(text)
    return copy


@pytest.fixture
def scenario(folder: Path) -> Scenario:
    return read_scenario(folder / "scenario/scenario.sumocfg", "ego", 720.0)


@pytest.fixture
def layout(folder: Path, scenario: Scenario) -> Layout:
    """Return a function that gives the layout for lines of [behaviour]."""

    file = folder / "case.toml"
    text = re.sub("(?m)^(vtypes|parameters) = .*$", "", file.read_text())

    def read(vtypes: str, *lines: str) -> ParameterLayout:
        more = "\n".join(("[behaviour]", f"vtypes = {vtypes}", 'parameters = ["tau", "minGap"]', *lines))
        file.write_text(text.replace("[behaviour]", more))
        return layout_of(require_scenario(read_case(folder)), scenario)

    return read


def test_without_the_key_all_move_together(layout: Layout):
    together = layout('["car", "van", "lorry"]')
    assert together.groups == ()
    assert together.names == ("main", "on1", "tau", "minGap")


@pytest.mark.parametrize(
    ("vtypes", "apart", "groups"),
    [
        ('["van", "car"]', '"each"', (("van",), ("car",))),
        ('["lorry", "car", "bus", "van"]', '"trucks"', (("car", "van"), ("lorry", "bus"))),
        ('["lorry", "car", "bus"]', '[["bus", "lorry"], ["car"]]', (("bus", "lorry"), ("car",))),
        ('["car", "nobody"]', '[["car", "nobody"]]', (("car", "nobody"),)),
    ],
)
def test_groups(vtypes: str, apart: str, groups: tuple[tuple[str, ...], ...], layout: Layout):
    assert layout(vtypes, f"apart = {apart}").groups == groups


def test_within_a_group_vtypes_keep_their_proportions_to_its_first(layout: Layout, scenario: Scenario):
    apart = layout('["lorry", "car", "bus", "van"]', 'apart = "trucks"')
    assert apart.names == ("main", "on1", "tau[car]", "minGap[car]", "tau[lorry]", "minGap[lorry]")
    car = scenario.values_of("car")["tau"]
    behaviour = (1.3, 2.2, 1.8, 3.1)
    assert apart.values_of("car", behaviour) == {"tau": 1.3, "minGap": 2.2}
    assert apart.values_of("van", behaviour)["tau"] == pytest.approx(1.3 * 1.5 / car)
    assert apart.values_of("lorry", behaviour) == {"tau": 1.8, "minGap": 3.1}
    assert apart.values_of("bus", behaviour)["tau"] == pytest.approx(1.8 * 2.5 / 2.0)
    (told,) = vtype_warnings(scenario, apart)
    assert "vtypes of a group differ in the scenario; they keep their proportions" in told
    alike = layout('["lorry", "car", "bus", "van"]', 'apart = "trucks"', 'common = "values"')
    assert alike.values_of("bus", behaviour) == alike.values_of("lorry", behaviour)


def test_nothing_is_said_of_vtypes_that_differ_between_groups_only(layout: Layout, scenario: Scenario):
    assert vtype_warnings(scenario, layout('["car", "lorry"]', 'apart = "each"')) == []


@pytest.mark.parametrize(
    ("vtypes", "apart", "says"),
    [
        ('["car", "van"]', '"trucks"', "behaviour.apart: expected some of vClass truck, trailer, bus or coach among"),
        ('["lorry", "bus"]', '"trucks"', "behaviour.apart: expected others beside vClass truck, trailer, bus or coach"),
        ('["car", "van"]', '[["car"]]', 'behaviour.apart: expected every vType in a group; "van" is in none.'),
        ('["car", "van"]', '[["car", "van"], ["car"]]', 'expected each vType in one group, got "car" again.'),
        ('["car", "van"]', '[["car", "van", "bus"]]', 'expected vTypes of behaviour.vtypes (car, van), got "bus".'),
        ('["car", "nobody"]', '"each"', 'behaviour.apart: expected vehicles of vType "nobody" on the route'),
        ('["nobody", "car"]', None, 'behaviour.vtypes: expected vehicles of vType "nobody" on the route'),
    ],
)
def test_groups_that_cannot_be(vtypes: str, apart: str | None, says: str, layout: Layout):
    with pytest.raises(CaseError, match=re.escape(says)):
        layout(vtypes, *([] if apart is None else [f"apart = {apart}"]))


def test_more_parameters_than_a_design_holds_are_refused(layout: Layout, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("jaxcalib.problem.parameter_layout.MOST_DRIVER_PARAMETERS", 5)
    with pytest.raises(CaseError, match="at most 5 driver parameters, got 3 groups of 2"):
        layout('["car", "van", "lorry"]', 'apart = "each"')
