"""The gain that is left without the drive that favours an effect most."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.leave_one_out import least_gain
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained

CELLS = (Cell(Channel.REPLAY, "residual_mps2"),)
GAINS = np.asarray([2.0, 30.0, 3.0, 1.0])  # what each drive adds


def prepared(drives: DriveTallies) -> Any:
    if drives.above[:, 0].min() > 1.0:  # without the last one
        raise NotTestableError("too little")
    return SimpleNamespace(tallies=drives, null=SimpleNamespace(cells=CELLS))


def explain(some: Any, signatures: Any) -> list[Explained]:
    assert not signatures
    return [Explained("none", -100.0), Explained("memory", -100.0 + float(some.tallies.above.sum()))]


def test_the_drive_that_favours_most_is_left_out_and_too_few_are_passed_over():
    tallies = DriveTallies(CELLS, GAINS[:, None], np.ones((4, 1)), np.zeros(4))
    fitted = cast(Any, SimpleNamespace(tallies=tallies))
    assert least_gain(fitted, {}, prepared, explain) == 6.0
    pair = cast(Any, SimpleNamespace(tallies=tallies.take([1, 2])))
    assert least_gain(pair, {}, prepared, explain) == 0.0  # neither drive alone shows enough
