"""Each wrong input ends with exit code 2 and one line that names file, place and what was expected."""

import gzip
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from jaxcalib.cli.app import calibrate, check
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from tests.copies import copy_corridor

CONFIG, DEMAND = "scenario/scenario.sumocfg", "scenario/demand.rou.xml"
SUBJECT, OBJECTS = "field/d01_subject.csv.gz", "field/d01_objects.csv.gz"


def replaced(file: str, old: str, new: str, count: int = 1) -> Callable[[Path], None]:
    """Return what replaces text in a file of the case."""

    def spoil(case: Path) -> None:
        path = case / file
        text = gzip.decompress(path.read_bytes()).decode() if file.endswith(".gz") else path.read_text()
        assert re.search(old, text), f"{old} is not in {file}"
        text = re.sub(old, new, text, count=count)
        path.write_bytes(gzip.compress(text.encode()) if file.endswith(".gz") else text.encode())

    return spoil


def missing(file: str) -> Callable[[Path], None]:
    return lambda case: (case / file).unlink()


def backwards(case: Path) -> None:
    """Move one row of the subject vehicle's log an hour back."""
    path = case / SUBJECT
    rows = gzip.decompress(path.read_bytes()).decode().splitlines()
    first, rest = rows[40].split(",", 1)
    rows[40] = f"{float(first) - 3600.0},{rest}"
    path.write_bytes(gzip.compress("\n".join(rows).encode()))


def off_the_map(case: Path) -> None:
    path = case / SUBJECT
    rows = gzip.decompress(path.read_bytes()).decode().splitlines()
    column = rows[0].split(",").index("latitude_rad")
    for number in range(1, len(rows)):
        cells = rows[number].split(",")
        cells[column] = str(float(cells[column]) + 0.01)
        rows[number] = ",".join(cells)
    path.write_bytes(gzip.compress("\n".join(rows).encode()))


WRONG = {
    "a missing file": (missing(OBJECTS), "d01"),
    "a missing network": (missing("scenario/net.net.xml"), "net.net.xml"),
    "a projection that only SUMO knows": (
        replaced("scenario/net.net.xml", 'projParameter="[^"]*"', 'projParameter="-"'), "columns x_m, y_m"),
    "a missing key": (replaced("case.toml", r"step_s *= .*\n", ""), "scenario.step_s"),
    "a missing column": (replaced(SUBJECT, "speed_kmh,", "velocity,"), "speed_kmh"),
    "text in a number column": (replaced(OBJECTS, r"\n(\d+\.\d+),", "\nnoon,"), "d01_objects"),
    "time running backwards": (backwards, "d01_subject"),
    "a log off the map": (off_the_map, "d01_subject"),
    "two drives with one id": (replaced("case.toml", '"d02"', '"d01"'), "drive[2].id"),
    "all drives held out": (replaced("case.toml", '"fit"', '"held_out"', 0), "drive"),
    "an unknown flow": (replaced("case.toml", '"f_on1_o1"', '"f_nowhere"'), "f_nowhere"),
    "an unknown parameter": (replaced("case.toml", '"tau"', '"tauu"'), "behaviour.parameters"),
    "another model": (replaced("case.toml", '"IDM"', '"W99"'), "car_following|parameters"),
    "an unknown model": (replaced("case.toml", '"IDM"', '"Wiedemann"'), "car_following"),
    "a DOCTYPE": (replaced(DEMAND, "<routes", "<!DOCTYPE routes [<!ENTITY a 'b'>]>\n<routes"), "demand.rou.xml"),
    "a network elsewhere that is not there": (
        replaced(CONFIG, r'value="net\.net\.xml"', 'value="../../../net.net.xml"'), "net.net.xml"),
}  # fmt: skip


@pytest.fixture
def case(tmp_path: Path) -> Path:
    return copy_corridor(tmp_path / "case", "d01", "d02", "d03")


@pytest.mark.parametrize("name", WRONG)
def test_wrong_case(name: str, case: Path, capsys: pytest.CaptureFixture[str]):
    spoil, place = WRONG[name]
    spoil(case)
    before = sorted(case.parent.rglob("*"))
    assert calibrate(case, out=case.parent / "run", quiet=True) == EXIT_CASE_WRONG
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert len(lines[0]) <= 300 + len("jaxcalib: ")
    assert re.search(place, lines[0]) or place in lines[0]
    assert sorted(case.parent.rglob("*")) == before  # nothing half-written


def test_outputs_that_a_configuration_asks_for_are_never_written(case: Path, capsys: pytest.CaptureFixture[str]):
    aim = case.parent / "stolen.xml"
    text = (case / CONFIG).read_text()
    end = "</configuration>"
    asked = f'<output><tripinfo-output value="{aim}"/></output><traci_server><remote-port value="9"/></traci_server>'
    (case / CONFIG).write_text(text.replace(end, asked + end))
    from jaxcalib.problem.problem import read_problem

    problem = read_problem(case)
    assert any("tripinfo-output" in line or "output" in line for line in problem.warnings())
    assert not aim.exists()


def test_run_folder_of_another_case(case: Path, capsys: pytest.CaptureFixture[str]):
    from jaxcalib.case.case import read_case
    from jaxcalib.runs.run_folder import identify, open_run_folder

    out = case.parent / "run"
    with open_run_folder(out, identify(read_case(case), {"seed": 0}), False):
        pass
    toml = case / "case.toml"
    toml.write_text(toml.read_text().replace('name = "corridor"', 'name = "elsewhere"'))
    assert calibrate(case, out=out, resume=True, quiet=True) == EXIT_CASE_WRONG
    assert "run.json: case" in capsys.readouterr().err


@pytest.mark.parametrize("file", [OBJECTS, DEMAND])
def test_a_run_is_bound_to_files_that_lie_elsewhere(case: Path, file: str):
    from jaxcalib.case.case import read_case
    from jaxcalib.runs.run_folder import files_elsewhere, identify

    elsewhere = case.parent / "elsewhere" / Path(file).name
    elsewhere.parent.mkdir()
    (case / file).rename(elsewhere)
    naming, old = ("case.toml", file) if file == OBJECTS else (CONFIG, Path(file).name)
    (case / naming).write_text((case / naming).read_text().replace(f'"{old}"', f'"{elsewhere}"'))
    assert files_elsewhere(read_case(case)) == (elsewhere.resolve(),)
    before = identify(read_case(case), {})
    elsewhere.write_bytes(elsewhere.read_bytes() + b" ")
    after = identify(read_case(case), {})
    assert (before["case"] == after["case"], before["program"] == after["program"]) == (False, True)


def test_a_check_does_not_keep_a_run_from_going_on(case: Path):
    from jaxcalib.case.case import read_case
    from jaxcalib.runs.run_folder import identify

    before = identify(read_case(case), {})
    assert check(case) == 0
    assert (case / "check.html").exists()
    assert identify(read_case(case), {}) == before
    (case / "scenario/check.html").write_text("of the user's own")
    assert identify(read_case(case), {}) != before


def test_a_begun_run_needs_resume_and_the_same_options(case: Path, capsys: pytest.CaptureFixture[str]):
    from jaxcalib.case.case import read_case
    from jaxcalib.runs.run_folder import identify, open_run_folder

    out = case.parent / "run"
    with open_run_folder(out, identify(read_case(case), {"seed": 5}), False):
        pass
    assert calibrate(case, out=out, seed=5, quiet=True) == EXIT_CASE_WRONG
    assert "--resume" in capsys.readouterr().err
    assert calibrate(case, out=out, seed=6, resume=True, quiet=True) == EXIT_CASE_WRONG
    assert "options" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("bounds.tau = [2.0, 1.0]", "bounds.tau"),
        ("bounds.speed = [1.0, 2.0]", "bounds.speed"),
        ("bounds.tau = [-1.0, 2.0]", "bounds.tau"),
        ('bounds = {tau = [1.0, 2.0], minGap = "wide"}', "bounds.minGap"),
        ('also_match = ["ttc"]', "also_match"),
        ("scaling = 0.1", "settings.toml"),
        ("scaling_factor = 2.0", "scaling_factor"),
        ("objective = ", "settings.toml"),
    ],
)
def test_wrong_settings(text: str, place: str, case: Path, capsys: pytest.CaptureFixture[str]):
    settings = case.parent / "settings.toml"
    settings.write_text(text)
    assert calibrate(case, out=case.parent / "run", settings=settings, quiet=True) == EXIT_CASE_WRONG
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert place in lines[0]
    assert "settings.toml: " in lines[0]
    assert not (case.parent / "run").exists()
