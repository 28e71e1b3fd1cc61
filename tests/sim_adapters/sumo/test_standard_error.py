"""What SUMO says on standard error is kept whole in the run's log, and said to the user once for each kind of line."""

import os
from pathlib import Path

import pytest

from sim_adapters.sumo.worker import STANDARD_ERROR, standard_error_in


def test_what_is_said_of_every_vehicle_is_said_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    lines = [f"Error: Vehicle 'slow.{number}' is too fast, time={number}.5.\n" for number in range(50)]
    other = "Error: a stop is behind its vehicle.\n"
    for run in range(3):
        with standard_error_in(tmp_path / f"{run}.log"):
            os.write(STANDARD_ERROR, "".join([*lines, other]).encode())
    assert all((tmp_path / f"{run}.log").read_text() == "".join([*lines, other]) for run in range(3))
    said = capfd.readouterr().err.splitlines(keepends=True)
    assert said == [lines[0], other]
