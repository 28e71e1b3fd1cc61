"""The bank: what is kept is read and not made again, and links of the inference come back."""

from pathlib import Path

import numpy as np
import pytest

from experiments.diagnosis_bank.__main__ import judge
from experiments.diagnosis_bank.kept_case import NotKeptError, ReadOnlyParts
from experiments.diagnosis_bank.links import LINKS, without
from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts


def test_what_is_kept_is_read_and_what_is_not_is_never_made(tmp_path: Path):
    cells = (Cell(Channel.REPLAY, "residual_mps2"),)
    made = DriveTallies(cells, np.asarray([[1.0], [3.0]]), np.ones((2, 1)), np.asarray([20.0, 60.0]))
    FinishedParts(tmp_path).tallies("effects", lambda: {"memory 0.5": made})
    kept = ReadOnlyParts(tmp_path)
    found = kept.tallies("effects", lambda: pytest.fail("it is there"))
    np.testing.assert_array_equal(found["memory 0.5"].above, made.above)
    with pytest.raises(NotKeptError, match="nearby"):
        kept.tallies("nearby", lambda: pytest.fail("it is not to be made"))


@pytest.mark.parametrize("name", LINKS)
def test_a_link_is_off_for_a_while_only(name: str):
    before = [getattr(owner, attribute) for owner, attribute, _ in LINKS[name]]
    with without([name]):
        assert all(getattr(owner, attribute) is instead for owner, attribute, instead in LINKS[name])
    assert [getattr(owner, attribute) for owner, attribute, _ in LINKS[name]] == before


def test_a_link_that_is_not_there_is_refused_by_name(tmp_path: Path):
    with pytest.raises(SystemExit, match=r"--off: expected one of .*heavy_tail.* got tempred"):
        judge(tmp_path, tmp_path, tmp_path / "out", off=["tempred"])
