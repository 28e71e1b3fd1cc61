"""`jaxcalib new` writes a case and checks it at once; what is wrong ends with one line, and leaves nothing behind."""

from pathlib import Path

import pytest

from jaxcalib.cli.app import app, new
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from tests.places import CORRIDOR

CONFIG = CORRIDOR / "scenario/scenario.sumocfg"
TABLES = [str(CORRIDOR / f"field/d0{number}_{what}.csv.gz") for number in (1, 2, 3) for what in ("subject", "objects")]


def test_several_drives_may_follow_one_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = tmp_path / "made"
    command = ["new", str(folder), "--scenario", str(CONFIG), "--drive", *TABLES]
    assert app(command, result_action="return_value") == 0
    said = capsys.readouterr().out
    assert f"{folder}/case.toml is written." in said
    assert "The surrogate follows every part of the scenario of made." in said
    assert (folder / "case.toml").read_text().count("[[drive]]") == 3


def test_a_missing_table_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    drive = (tmp_path / "none_subject.csv", tmp_path / "none_objects.csv")
    assert new(tmp_path / "made", scenario=CONFIG, drive=(drive,)) == EXIT_CASE_WRONG
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("jaxcalib: command line: --drive: expected an existing file")
    assert not (tmp_path / "made").exists()


def test_a_scenario_that_sumo_refuses_leaves_nothing_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    config = tmp_path / "my.sumocfg"
    config.write_text(CONFIG.read_text().replace('"net.net.xml"', f'"{CORRIDOR}/scenario/net.net.xml"'))
    demand = (CORRIDOR / "scenario/demand.rou.xml").read_text().replace('type="car"', 'type="lorry"', 1)
    (tmp_path / "demand.rou.xml").write_text(demand)
    drive = (Path(TABLES[0]), Path(TABLES[1]))
    assert new(tmp_path / "made", scenario=config, drive=(drive,)) == EXIT_CASE_WRONG
    (line,) = capsys.readouterr().err.splitlines()
    assert "my.sumocfg: SUMO refuses the scenario" in line
    assert "'lorry'" in line
    assert not (tmp_path / "made").exists()
