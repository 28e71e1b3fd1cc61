"""`jaxcalib check` says all that is wrong or odd at once, and how well the surrogate can follow."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from jaxcalib.check.scenario_check import CaseCheck, check_case
from jaxcalib.cli.app import check
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from tests.copies import copy_corridor

CONFIG, DEMAND = "scenario/scenario.sumocfg", "scenario/demand.rou.xml"
WHILE_IT_TAKES_S = 120.0  # of SUMO's run, however busy the machine is


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a copy of the corridor with a drive to fit and one held out."""
    return copy_corridor(tmp_path / "corridor", "d01", "d03")


@pytest.fixture
def spoilt(folder: Path) -> Callable[..., CaseCheck]:
    """Return what alters text of the copy's files and checks it."""

    def alter(*edits: tuple[str, str, str]) -> CaseCheck:
        for name, old, new in edits:
            text = (folder / name).read_text()
            assert old in text
            (folder / name).write_text(text.replace(old, new))
        return check_case(folder, first_run_s=WHILE_IT_TAKES_S)

    return alter


def test_a_sound_case(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert check(folder) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "The surrogate follows every part of the scenario of corridor." in captured.out
    assert "input main: 2 flows" in captured.out
    assert "A calibration searches in the surrogate, and is confirmed in SUMO." in captured.out


def test_vtypes_that_move_apart_are_told(folder: Path, capsys: pytest.CaptureFixture[str]):
    case, demand = folder / "case.toml", folder / DEMAND
    vtypes = '["lorry", "car"]\napart = "trucks"'
    case.write_text(re.sub(r"vtypes = .*", f"vtypes = {vtypes}", case.read_text()))
    lorry = '<vType id="lorry" vClass="truck" carFollowModel="IDM"/>'
    text = demand.read_text().replace("<vType ", f"{lorry}<vType ", 1)
    demand.write_text(text.replace('<flow id="f_on1_e" type="car"', '<flow id="f_on1_e" type="lorry"'))
    assert check(folder) == 0
    lines = capsys.readouterr().out.splitlines()
    told = [line for line in lines if line.startswith("vTypes")]
    assert told == [f"vTypes {vtype}: driver parameters of their own" for vtype in ("car", "lorry")]
    case.write_text(case.read_text().replace('"trucks"', '[["car"]]'))
    assert check(folder) == EXIT_CASE_WRONG
    assert 'behaviour.apart: expected every vType in a group; "lorry" is in none.' in capsys.readouterr().err


def test_what_the_first_run_showed(spoilt: Callable[..., CaseCheck]):
    run = spoilt().first_run
    assert run is not None
    assert run.is_whole
    assert run.entered_s == pytest.approx(300.1)
    # 3.3 km at no more than the subject vehicle's 20 m/s, and the drive of the log took 165 s
    assert run.arrived_s is not None
    assert 300.0 + 3200.0 / 20.0 < run.arrived_s < 300.0 + 2.0 * 165.0


def test_all_that_is_wrong_is_said_at_once(folder: Path, capsys: pytest.CaptureFixture[str]):
    toml = folder / "case.toml"
    text = toml.read_text().replace('"IDM"', '"W99"').replace('"f_on1_o1"', '"f_nowhere"')
    toml.write_text(text.replace('vtype        = "subject"', 'vtype = "robot"'))
    log = folder / "field/d03_subject.csv.gz"
    log.write_bytes(gzip.compress(gzip.decompress(log.read_bytes()).replace(b"speed_kmh,", b"velocity,", 1)))
    assert check(folder) == EXIT_CASE_WRONG
    captured = capsys.readouterr()
    lines = captured.err.splitlines()
    for words in ("behaviour.car_following", "f_nowhere", "subject.vtype", "d03_subject.csv.gz: column"):
        assert sum(words in line for line in lines) == 1, words
    assert all(line.startswith("jaxcalib: ") for line in lines)
    assert "A calibration searches" not in captured.out


def test_what_sumo_refuses_comes_with_what_the_logs_lack(folder: Path, capsys: pytest.CaptureFixture[str]):
    demand = folder / DEMAND
    demand.write_text(demand.read_text().replace('period="exp(0.130000)"', 'probability="1.5"'))
    log = folder / "field/d01_objects.csv.gz"
    log.write_bytes(gzip.compress(gzip.decompress(log.read_bytes()).replace(b"lane,", b"track,", 1)))
    assert check(folder) == EXIT_CASE_WRONG
    captured = capsys.readouterr()
    first, second = captured.err.splitlines()
    assert "SUMO refuses the scenario: Invalid repetition probability in the definition of flow 'f_main_o1'." in first
    assert "between 0 and 1" in first
    assert "d01_objects.csv.gz: column lane" in second
    assert captured.out.splitlines() == [f"figure: {folder / 'check.html'}"]


EGO = 'route="r_ego" depart="300" departLane="best" departPos="last" departSpeed="avg"'


def test_a_subject_vehicle_that_never_enters_is_refused(spoilt: Callable[..., CaseCheck]):
    """Somebody stands for ever where it is to enter."""
    stands = (
        '<vehicle id="stands" type="car" route="r_ego" depart="0" departLane="0" departPos="5">'
        '<stop lane="in0_0" endPos="5" duration="9999"/></vehicle>\n    <flow id="f_main_o1"'
    )
    there = 'route="r_ego" depart="300" departLane="0" departPos="0"'
    (line,) = spoilt((DEMAND, EGO, there), (DEMAND, '<flow id="f_main_o1"', stands)).refusals
    assert line.startswith(
        "demand.rou.xml: expected vehicle 'ego' to enter; in a run of SUMO it waits before edge 'in0'"
    )
    assert "departSpeed" in line


def test_a_run_that_sumo_ends_is_told_in_its_words(spoilt: Callable[..., CaseCheck]):
    (line,) = spoilt((DEMAND, EGO, 'route="r_ego" depart="300" departSpeed="45"')).refusals
    expected = "scenario.sumocfg: SUMO ends a run of the scenario: Departure speed for vehicle 'ego' is too high"
    assert line.startswith(expected)


def test_a_subject_vehicle_that_no_lane_lets_in_is_refused_for_that(spoilt: Callable[..., CaseCheck]):
    lanes = [
        ("scenario/net.net.xml", f'<lane id="in0_{index}" index="{index}"',
         f'<lane id="in0_{index}" index="{index}" disallow="bicycle"') for index in range(3)
    ]  # fmt: skip
    found = spoilt((DEMAND, '<vType id="subject" vClass="passenger"', '<vType id="subject" vClass="bicycle"'), *lanes)
    (line,) = found.refusals
    assert "ego" in line
    assert "in0" in line
    assert "allow" in line


def test_a_subject_vehicle_that_does_not_arrive_is_a_warning(spoilt: Callable[..., CaseCheck]):
    found = spoilt((DEMAND, 'edges="in0 m0 m1 m2 m3 m4 m5 m6 m7 m8"/>\n    <route id="r_main_o1"',
                    'edges="in0 m0 m1 m2 m3 m4 m5 m6 m7 m8"><stop lane="m4_1" endPos="90" duration="9999"/></route>\n'
                    '    <route id="r_main_o1"'))  # fmt: skip
    assert found.refusals == ()
    (line,) = [line for line in found.warnings if "does not arrive" in line]
    assert "vehicle 'ego' enters at 300.1 s" in line
    assert "on edge 'm4'" in line


def test_a_flow_that_no_lane_can_carry_is_told_with_its_backlog(spoilt: Callable[..., CaseCheck]):
    found = spoilt((DEMAND, 'period="exp(0.127111)"', 'period="exp(2.5)"'))
    (line,) = [line for line in found.warnings if "wait outside" in line]
    backlog = re.search(r"flows from edge 'in1': at [\d.]+ s in a run of SUMO (\d+) vehicles wait outside", line)
    assert backlog is not None
    # 2.5 vehicles a second come for 300 s and more; one lane takes no more than one in 1.2 s
    assert int(backlog.group(1)) > 300 * (2.5 - 1 / 1.2)


def test_an_end_before_the_begin(spoilt: Callable[..., CaseCheck]):
    (line,) = spoilt((CONFIG, '<begin value="0"/>', '<begin value="28800"/>')).refusals
    assert line.startswith("scenario.sumocfg: option 'end': expected an end after its begin, 28800 s, got 720 s")


def test_packed_networks_and_several_files_with_spaces_in_their_names(folder: Path):
    scenario = folder / "scenario"
    (scenario / "my net.net.xml.gz").write_bytes(gzip.compress((scenario / "net.net.xml").read_bytes()))
    (scenario / "net.net.xml").unlink()
    (scenario / "demand.rou.xml").rename(scenario / "my demand.rou.xml")
    loop = '<additional><inductionLoop id="{0}" lane="m4_0" pos="10" file="my {0}.xml"/></additional>'
    for name in ("loop one", "loop two"):
        (scenario / f"{name}.add.xml").write_text(loop.format(name.replace(" ", "_")))
    config = folder / CONFIG
    text = config.read_text().replace('"net.net.xml"', '"my net.net.xml.gz"')
    text = text.replace(
        '"demand.rou.xml"/>', '"my demand.rou.xml"/><additional-files value="loop one.add.xml,loop two.add.xml"/>'
    )
    config.write_text(text)
    found = check_case(folder, first_run_s=WHILE_IT_TAKES_S)
    assert found.refusals == ()
    assert {finding.file for finding in found.findings} == {"loop one.add.xml", "loop two.add.xml"}
    assert found.first_run is not None
    assert found.first_run.arrived_s is not None
    assert not list(folder.rglob("my loop_one.xml"))  # checking writes nothing


def test_a_page_that_was_asked_for_and_cannot_be_written_is_an_error(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert check(folder, out=folder) == EXIT_CASE_WRONG
    assert f"{folder.name}: expected a folder that can be written to" in capsys.readouterr().err
