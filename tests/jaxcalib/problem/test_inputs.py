"""Which inputs a case has: its own, by window of time, or those that the scenario shows."""

import shutil
from pathlib import Path

import pytest

from jaxcalib.case.case import read_case, require_scenario
from jaxcalib.errors import CaseError
from jaxcalib.problem.inputs import read_scenario_of
from jaxcalib.problem.problem_checks import input_faults
from tests.places import CORRIDOR

ON = 'id    = "on1"\nflows = ["f_on1_o1", "f_on1_e"]\n'


@pytest.fixture
def case(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CORRIDOR, tmp_path / "case"))


def change(case: Path, text: str) -> None:
    file = case / "case.toml"
    before = file.read_text()
    assert ON in before
    file.write_text(before.replace(ON, text, 1))


def test_an_input_with_windows_is_one_for_each_window_in_which_its_flows_come(case: Path):
    demand = case / "scenario/demand.rou.xml"
    text = demand.read_text()
    late = 'route="r_on1_o1" begin="400" end="720"'
    demand.write_text(text.replace('route="r_on1_o1" begin="0" end="720"', late, 1))
    change(case, ON + "windows_s = [0, 350, 700, 900]\n")
    scenario, parts = read_scenario_of(require_scenario(read_case(case)))
    assert {entrance.id: entrance.flows for entrance in parts.inputs} == {
        "main": ("f_main_o1", "f_main_e"),
        "on1@0": ("f_on1_e@0",),
        "on1@350": ("f_on1_o1@350", "f_on1_e@350"),
        "on1@700": ("f_on1_o1@700", "f_on1_e@700"),
    }
    assert not input_faults(scenario, parts)
    assert scenario.mean_rate_vehps("f_on1_o1@350") == pytest.approx(0.017333)


def test_unknown_flows_are_named_with_and_without_windows(case: Path):
    change(case, ON.replace("f_on1_e", "f_none") + "windows_s = [0, 350]\n")
    scenario, parts = read_scenario_of(require_scenario(read_case(case)))
    assert any("f_none" in str(fault) for fault in input_faults(scenario, parts))


@pytest.mark.parametrize(("windows", "words"), [("[350, 0]", "rising times, got 350, 0"), ("[350]", "at least two")])
def test_windows_that_are_none_are_refused(case: Path, windows: str, words: str):
    change(case, ON + f"windows_s = {windows}\n")
    with pytest.raises(CaseError, match=words):
        read_case(case)
