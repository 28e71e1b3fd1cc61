"""One line that names the file, the place and what was expected."""

import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.errors import LONGEST_MESSAGE, CaseError, quote, shorten


def test_names_the_file_without_its_folder():
    assert str(CaseError(Path("/some/where/d01.csv"), "row 3", "expected less.")) == "d01.csv: row 3: expected less."


def test_leaves_out_an_empty_place():
    assert str(CaseError("case.toml", "", "expected TOML.")) == "case.toml: expected TOML."


@given(st.text(), st.text(max_size=2000), st.text(max_size=2000))
def test_is_one_short_printable_line(file: str, place: str, expected: str):
    line = str(CaseError(file.replace("\0", ""), place, expected))
    assert len(line) <= LONGEST_MESSAGE
    assert line.isprintable()


def test_strips_what_would_move_the_cursor():
    assert shorten("a\x1b[2Jb\u202ec\r\nd") == "a[2Jbc  d"


def test_survives_pickling():
    error = CaseError("case.toml", "name", "expected text.")
    again = pickle.loads(pickle.dumps(error))  # noqa: S301
    assert str(again) == str(error)
    assert again.place == "name"


@pytest.mark.parametrize(
    ("value", "shown"),
    [("far", '"far"'), (True, "true"), (3, "3"), ([], "an empty list"), ([1], "a list"), ({}, "a table")],
)
def test_quotes_values(value: object, shown: str):
    assert quote(value) == shown
