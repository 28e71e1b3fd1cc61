"""A case made of a scenario and logs says what the one written by hand says, wherever nobody had to know more."""

import gzip
import re
import shutil
from pathlib import Path

import pytest

from jaxcalib.case.case import Case, read_case, require_scenario
from jaxcalib.errors import CaseError
from jaxcalib.new_case.new_case import make_case
from jaxcalib.new_case.recorded_drives import roles_of
from jaxcalib.problem.problem import read_problem
from sim_adapters.scenario.configuration import read_configuration
from sim_adapters.scenario.sumo_files import read_xml
from tests.places import CORRIDOR, SHARED_CASES

CONFIG = "scenario/scenario.sumocfg"
EGO = re.compile(r"\s*<vehicle id=\"ego\".*?/>")


def tables_of(case: Path) -> list[tuple[Path, Path]]:
    subjects = sorted((case / "field").glob("*_subject.csv.gz"))
    return [(file, file.with_name(file.name.replace("subject", "objects"))) for file in subjects]


def flows_of(case: Case) -> set[frozenset[str]]:
    return {frozenset(entrance.flows) for entrance in case.inputs}


@pytest.fixture(params=[CORRIDOR, SHARED_CASES / "corridor"], ids=["repository", "shared"])
def written_by_hand(request: pytest.FixtureRequest) -> Path:
    if not request.param.is_dir():
        pytest.skip(f"{request.param} is not there")
    return request.param


def test_the_case_is_the_one_written_by_hand(written_by_hand: Path, tmp_path: Path):
    folder = tmp_path / "made"
    assert make_case(folder, written_by_hand / CONFIG, tables_of(written_by_hand)) == ()
    made, by_hand = read_case(folder), read_case(written_by_hand)
    assert flows_of(made) == flows_of(by_hand)
    assert made.perception == by_hand.perception
    parts, expected = require_scenario(made), require_scenario(by_hand)
    assert parts.subject == expected.subject
    assert (parts.behaviour.vtypes, parts.behaviour.car_following) == (
        expected.behaviour.vtypes, expected.behaviour.car_following,
    )  # fmt: skip
    assert parts.scenario.config_file.resolve() == expected.scenario.config_file.resolve()
    assert (parts.scenario.step_s, parts.scenario.duration_s) == (
        expected.scenario.step_s,
        expected.scenario.duration_s,
    )
    assert [drive.id for drive in made.drives] == [drive.id for drive in by_hand.drives]
    for drive, other in zip(made.drives, by_hand.drives, strict=True):
        assert drive.subject_file.resolve() == other.subject_file.resolve()
        assert drive.depart_s == pytest.approx(other.depart_s, abs=2.0)  # logs begin when the vehicle is first seen
    assert len(made.drives_of("held_out")) == len(by_hand.drives_of("held_out")) == 4
    problem = read_problem(folder)  # all of it is read, and measured
    assert problem.scenario.flow_ids == read_problem(written_by_hand).scenario.flow_ids


def test_each_guess_is_told(tmp_path: Path):
    make_case(tmp_path / "made", CORRIDOR / CONFIG, tables_of(CORRIDOR))
    text = (tmp_path / "made/case.toml").read_text()
    for key in ("warmup_s", "vehicle", "ahead_m", "behind_m", "nominal_length_m", "depart_s"):
        assert re.search(rf"^{key} = .*# guess: ", text, re.MULTILINE), key
    assert "# guess: a third of the drives is held out.\n[[drive]]" in text
    assert re.search(r'^id = "in0"  # the edge; 3900 veh/h in the scenario$', text, re.MULTILINE)


def test_a_scenario_without_subject_vehicle_gets_one_along_the_log(tmp_path: Path):
    """Its files lie in a folder whose name has spaces; none of them is changed."""
    original = tmp_path / "my scenario"
    shutil.copytree(CORRIDOR / "scenario", original)
    demand = original / "demand.rou.xml"
    demand.write_text(EGO.sub("", demand.read_text()))
    before = {file.name: file.read_bytes() for file in original.iterdir()}
    folder = tmp_path / "made"
    (line,) = make_case(folder, original / "scenario.sumocfg", tables_of(CORRIDOR)[:3])
    assert line.startswith("ego.rou.xml: ")
    assert {file.name: file.read_bytes() for file in original.iterdir()} == before
    assert sorted(file.name for file in folder.iterdir()) == ["case.toml", "ego.rou.xml", "scenario.sumocfg"]
    configuration = read_configuration(folder / "scenario.sumocfg")
    assert configuration.net_file == (original / "net.net.xml").resolve()
    assert configuration.processing == read_configuration(original / "scenario.sumocfg").processing
    problem = read_problem(folder)
    by_hand = read_problem(CORRIDOR).scenario
    assert problem.scenario.demand.subject_route == by_hand.demand.subject_route
    assert problem.parts.subject.vehicle == "ego"
    # the vType "subject" is still there, so that the new one has another name
    assert problem.scenario.demand.subject_vtype == problem.parts.subject.vtype == "subject_1"
    highest_mps = max(drive.subject.speed_mps.max() for drive in problem.drives)
    assert problem.scenario.values_of("subject_1")["maxSpeed"] == pytest.approx(highest_mps, abs=0.01)


def test_places_alone_lead_to_the_route(tmp_path: Path):
    """Where the column `road` names no edges, the route is matched by longitude and latitude."""
    original = tmp_path / "scenario"
    shutil.copytree(CORRIDOR / "scenario", original)
    demand = original / "demand.rou.xml"
    demand.write_text(EGO.sub("", demand.read_text()))
    subject, objects = tables_of(CORRIDOR)[0]
    text = re.sub(
        r"^([\d.]+),[a-z]+\d,", r"\1,A 9,", gzip.decompress(subject.read_bytes()).decode(), flags=re.MULTILINE
    )
    assert ",A 9," in text
    (tmp_path / "d01_subject.csv").write_text(text)
    make_case(tmp_path / "made", original / "scenario.sumocfg", [(tmp_path / "d01_subject.csv", objects)])
    (vehicle,) = (one for one in read_xml(tmp_path / "made/ego.rou.xml") if one.tag == "vehicle")
    (route,) = vehicle
    assert route.get("edges") == "in0 m0 m1 m2 m3 m4 m5 m6 m7 m8"
    assert [drive.role for drive in read_case(tmp_path / "made").drives] == ["fit"]


def test_a_subject_vehicle_may_be_named(tmp_path: Path):
    make_case(tmp_path / "made", CORRIDOR / CONFIG, tables_of(CORRIDOR)[:2], "ego")
    assert 'vehicle = "ego"  # as asked for' in (tmp_path / "made/case.toml").read_text()
    with pytest.raises(CaseError, match="expected a <vehicle id='robot'>"):
        make_case(tmp_path / "other", CORRIDOR / CONFIG, tables_of(CORRIDOR)[:2], "robot")
    assert not (tmp_path / "other").exists()


def test_a_drive_without_rows_is_left_out(tmp_path: Path):
    subject, objects = tables_of(CORRIDOR)[0]
    head = gzip.decompress(subject.read_bytes()).decode().splitlines()[0]
    (tmp_path / "empty_subject.csv").write_text(head + "\n")
    pairs = [(tmp_path / "empty_subject.csv", objects), *tables_of(CORRIDOR)[1:3]]
    (line,) = make_case(tmp_path / "made", CORRIDOR / CONFIG, pairs)
    assert "is left out: empty_subject.csv: expected at least two rows of data, got 0." in line
    assert len(read_case(tmp_path / "made").drives) == 2
    assert line in (tmp_path / "made/case.toml").read_text()
    with pytest.raises(CaseError, match="expected a drive with rows"):
        make_case(tmp_path / "other", CORRIDOR / CONFIG, pairs[:1])


def test_a_folder_that_holds_something_is_refused(tmp_path: Path):
    (tmp_path / "kept.txt").write_text("")
    with pytest.raises(CaseError, match="expected an empty folder"):
        make_case(tmp_path, CORRIDOR / CONFIG, tables_of(CORRIDOR)[:2])
    assert [file.name for file in tmp_path.iterdir()] == ["kept.txt"]


@pytest.mark.parametrize(("num_drives", "num_held_out"), [(1, 0), (2, 1), (3, 1), (4, 1), (5, 2), (6, 2), (12, 4)])
def test_a_third_is_held_out_and_one_at_least(num_drives: int, num_held_out: int):
    roles = roles_of(num_drives)
    assert len(roles) == num_drives
    assert roles.count("held_out") == num_held_out
    assert roles[0] == "fit"
