"""The rules of the house: floors, types, style."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.places import ROOT

SCRIPTS = Path(sys.executable).parent

CHECKS = {  # the fastest first
    "style": [str(SCRIPTS / "ruff"), "check", "."],
    "format": [str(SCRIPTS / "ruff"), "format", "--check", "."],
    "imports only go down": [str(SCRIPTS / "lint-imports"), "--no-cache"],
    "types": [str(SCRIPTS / "pyright"), "--pythonpath", sys.executable],
}


@pytest.mark.parametrize("name", CHECKS)
def test_house(name: str):
    done = subprocess.run(CHECKS[name], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
