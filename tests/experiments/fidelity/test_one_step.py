"""One step of both simulators from the same state: they agree, and where they do not it is seen."""

import numpy as np
import pandas as pd
import pytest

from experiments.fidelity.one_step import compare_steps, table_of
from jaxcalib.problem.problem import read_problem
from tests.places import CORRIDOR


@pytest.mark.nightly(
    "SUMO and the surrogate from one state, step by step, take half a minute; contracts compare both at commits"
)
def test_steps_from_the_same_state_are_alike() -> None:
    steps = compare_steps(read_problem(CORRIDOR), 90.0, 92.0, 3, 2.0)
    assert len(steps) > 1_000
    same = steps[steps["sumo_changes"] == steps["surrogate_changes"]]
    assert len(same) > 0.999 * len(steps)
    assert (
        np.abs(same["surrogate_mps2"] - same["sumo_mps2"]) <= 0.05
    ).mean() > 0.95  # of a few per cent the memories are not known so early


def test_the_table_counts_each_side_of_a_difference() -> None:
    steps = pd.DataFrame(
        {
            "kind": ["all others", "all others", "must change lane"],
            "sumo_mps2": [1.0, -0.2, 0.0],
            "surrogate_mps2": [1.01, 0.3, -0.5],
            "sumo_changes": [False, False, True],
            "surrogate_changes": [False, False, True],
        }
    )
    table = table_of(steps)
    cells = list(zip(*(column.cells for column in table.columns), strict=True))
    assert cells[0] == ("all others", "2", "50.00%", "50.00%", "0.00%", "+0.255", "0", "0", "0")
    assert cells[1] == ("must change lane", "1", "0.00%", "0.00%", "100.00%", "-0.500", "1", "1", "1")
