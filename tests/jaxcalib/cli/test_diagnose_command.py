"""The command: wrong input ends with exit code 2 and one line."""

from jaxcalib.cli.app import diagnose
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from tests.copies import copy_corridor
from tests.places import CORRIDOR


def test_no_case(tmp_path, capsys):
    assert diagnose(tmp_path / "nowhere", out=tmp_path / "run") == EXIT_CASE_WRONG
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_case_without_drive_to_fit(tmp_path, capsys):
    copy_corridor(tmp_path / "case", "d01", "d03")
    file = tmp_path / "case" / "case.toml"
    file.write_text(file.read_text().replace('"fit"', '"held_out"'))
    assert diagnose(tmp_path / "case", out=tmp_path / "run") == EXIT_CASE_WRONG
    assert "fit" in capsys.readouterr().err


def test_folder_of_somebody_else(tmp_path, capsys):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "letter.txt").write_text("mine")
    assert diagnose(CORRIDOR, out=tmp_path / "run") == EXIT_CASE_WRONG
    assert "empty folder" in capsys.readouterr().err
