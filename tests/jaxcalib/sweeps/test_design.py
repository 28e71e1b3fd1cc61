"""Designs: what they promise, and what they refuse."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxcalib.errors import CaseError
from jaxcalib.problem.parameter_space import ParameterSpace, Range
from jaxcalib.sweeps.design import make_design
from sim_adapters.interface import ParameterLayout
from tests.jaxcalib.search.strength_of_arrays import has_strength_two

LAYOUT = ParameterLayout(("main",), (("f",),), ("car",), ("tau", "minGap", "speedFactor", "lcKeepRight"))
SPACE = ParameterSpace(
    LAYOUT,
    (Range(1000.0, 3000.0, unit="veh/h"), Range(0.5, 2.0, True, "s"), Range(1.0, 4.0, True, "m"), Range(0.8, 1.2),
     Range(0.0, 5.0)),
)  # fmt: skip
BASE = np.asarray([1900.0, 1.1, 2.5, 1.05, 0.7])


def unit_of(values: np.ndarray) -> np.ndarray:
    return np.asarray([SPACE.unit_of(one) for one in values])


@settings(max_examples=20, deadline=None)
@given(
    kind=st.sampled_from(["sobol:64", "latin-hypercube:17", "lhs:5", "grid:2", "orthogonal-array:3", "oa:4"]),
    chosen=st.lists(st.sampled_from(SPACE.names), min_size=1, max_size=5, unique=True),
    seed=st.integers(0, 2000),
)
def test_only_what_varies_differs_from_the_scenario(kind: str, chosen: list[str], seed: int):
    design = make_design(kind, SPACE, BASE, chosen, seed)
    fixed = [SPACE.index(name) for name in SPACE.names if name not in chosen]
    assert np.all(design.values[:, fixed] == BASE[fixed])
    assert np.all((design.values >= SPACE.lower - 1e-9) & (design.values <= SPACE.upper + 1e-9))
    assert design.varied == tuple(chosen)
    again = make_design(kind, SPACE, BASE, chosen, seed)
    np.testing.assert_array_equal(design.values, again.values)


def test_a_sobol_design_is_even_on_each_scale():
    """Of 64 points of a (0, m, s)-sequence each of 64 slices holds one, on the scale of the parameter."""
    unit = unit_of(make_design("sobol:64", SPACE, BASE, None, 5).values)
    for column in unit.T:
        assert len(np.unique(np.floor(64 * np.clip(column, 0, 1 - 1e-9)))) >= 62  # rounded to 6 digits
    other = unit_of(make_design("sobol:64", SPACE, BASE, None, 6).values)
    assert not np.allclose(unit, other)


def test_a_latin_hypercube_has_one_point_in_each_slice():
    unit = unit_of(make_design("latin-hypercube:20", SPACE, BASE, None, 3).values)
    for column in unit.T:
        assert sorted(np.floor(20 * np.clip(column, 0, 1 - 1e-9)).astype(int).tolist()) == list(range(20))


def test_a_grid_has_every_combination_and_both_bounds():
    values = make_design("grid:3x2", SPACE, BASE, ["tau", "main"], 0).values
    assert len(np.unique(values, axis=0)) == 6
    assert sorted(set(values[:, 1].tolist())) == pytest.approx([0.5, 1.0, 2.0])  # even on its logarithmic scale
    assert sorted(set(values[:, 0].tolist())) == [1000.0, 3000.0]


def test_an_orthogonal_array_has_strength_two():
    design = make_design("orthogonal-array:4", SPACE, BASE, None, 0)
    levels = np.round(3 * unit_of(design.values)).astype(int)
    assert design.name == "orthogonal-array:4, L16(4^5)"
    assert has_strength_two(levels, 4)


def test_sobol_points_that_are_not_even_come_with_a_warning():
    design = make_design("sobol:100", SPACE, BASE, None, 0)
    assert len(design.values) == 100
    assert "128" in design.warnings[0]


@pytest.mark.parametrize(
    ("text", "chosen", "says"),
    [
        ("orthogonal-array:2:4", None, "supports 3 parameters; 5 vary"),
        ("grid:3x3", None, "supports 2 parameters; 5 vary"),
        ("grid:1000", None, "at most"),
        ("orthogonal-array:6", None, "number of levels among"),
        ("orthogonal-array:4:17", None, "16, 64"),
        ("orthogonal-array:many", None, "orthogonal-array:LEVELS"),
        ("grid:1", None, "grid:LEVELS"),
        ("sobol", None, "number of candidates"),
        ("sobol:0", None, "number of candidates"),
        ("sobol:-3", None, "number of candidates"),
        ("sobol:99999999999", None, "1 to"),
        ("halton:5", None, "sobol:N"),
        ("sobol:4", ["tauu"], "main, tau"),
        ("sobol:4", ["tau", "tau"], "each name once"),
        ("sobol:4", [], "at least one"),
        ("nowhere.csv", None, "can be read"),
        ("nowhere.csv", ["tau"], "none beside a table"),
    ],
)
def test_designs_that_are_refused(text: str, chosen: list[str] | None, says: str):
    with pytest.raises(CaseError, match=re.escape(says)) as caught:
        make_design(text, SPACE, BASE, chosen, 0)
    assert len(str(caught.value)) <= 300


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_of_one_s_own(tmp_path: Path, suffix: str):
    file = tmp_path / f"mine{suffix}"
    table = pa.table({"minGap_m": [2.25, 3.125], "main": [1500.5, 1600.25], "candidate": [4, 5]})
    if suffix == ".parquet":
        pq.write_table(table, file)
    else:
        file.write_text("minGap_m,main,candidate\n2.25,1500.5,4\n3.125,1600.25,5\n")
    design = make_design(str(file), SPACE, BASE, None, 0)
    assert design.varied == ("main", "minGap")
    np.testing.assert_allclose(design.values, [[1500.5, 1.1, 2.25, 1.05, 0.7], [1600.25, 1.1, 3.125, 1.05, 0.7]])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("tau,headway\n1,2\n", "column headway: expected columns among main, tau"),
        ("tau,tau_s\n1,2\n", "column tau_s"),
        ("tau\n1\nfast\n", "row 3, column tau"),
        ("tau,main\n1,\n", "row 2, column main: expected a number"),
        ("tau\n0\n", "row 2, column tau: expected a number above 0"),
        ("main\n-1\n", "row 2, column main: expected a number of 0 or more"),
        ("tau\n", "at least one row"),
        ("candidate\n3\n", "at least one column"),
        ("", "empty"),
    ],
)
def test_tables_that_are_refused(tmp_path: Path, text: str, says: str):
    file = tmp_path / "mine.csv"
    file.write_text(text)
    with pytest.raises(CaseError, match=re.escape(says)):
        make_design(str(file), SPACE, BASE, None, 0)
