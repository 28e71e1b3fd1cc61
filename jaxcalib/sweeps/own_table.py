"""A design of the user's own: a table with one candidate per row."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxcalib.errors import CaseError, quote
from jaxcalib.field.table_files import column_names, read_columns, row_place
from jaxcalib.problem.parameter_space import ParameterSpace, round_values
from jaxcalib.sweeps.columns import parameter_columns

IGNORED = ("candidate",)  # the tables that sweeps leave behind can be used as designs


def is_table(text: str) -> bool:
    """Return whether a design is the path of a table."""
    return text.lower().endswith((".csv", ".csv.gz", ".parquet"))


def read_own_table(
    path: str, space: ParameterSpace, base: Float[np.ndarray, " parameter"]
) -> tuple[Float[np.ndarray, "candidate parameter"], tuple[str, ...]]:
    """Return the candidates of a table, and which parameters it sets.

    Args:
        path: .csv, .csv.gz or .parquet; columns are parameters, by their name or by that of the sweep's column.
        space: the parameters.
        base: values of the parameters that have no column.

    Raises:
        CaseError: a column is no parameter or there twice, or a value is missing, or no driver or road can have it.
    """
    file = Path(path)
    name_of = {column: name for name, column in parameter_columns(space).items()} | {name: name for name in space.names}
    columns = [column for column in column_names(file) if column not in IGNORED]
    names = []
    for column in columns:
        if column not in name_of:
            known = ", ".join(space.names)
            raise CaseError(file, f"column {column}", f"expected columns among {known}.")
        if name_of[column] in names:
            raise CaseError(file, f"column {column}", f"expected parameter {quote(name_of[column])} once.")
        names.append(name_of[column])
    if not names:
        raise CaseError(file, "", "expected at least one column that names a parameter.")
    table = read_columns(file, {column: "number" for column in columns})
    if not table.num_rows:
        raise CaseError(file, "", "expected at least one row.")
    values = np.tile(np.asarray(base, float), (table.num_rows, 1))
    for column, name in zip(columns, names, strict=True):
        numbers = table.numbers[column]
        _check_values(file, column, numbers, space, name)
        values[:, space.index(name)] = numbers
    return round_values(values), tuple(name for name in space.names if name in names)


def _check_values(file: Path, column: str, numbers: np.ndarray, space: ParameterSpace, name: str) -> None:
    missing = np.flatnonzero(np.isnan(numbers))
    if len(missing):
        raise CaseError(file, row_place(missing[0], column), "expected a number, got nothing.")
    place = space.index(name)
    if space.ranges[place].is_logarithmic:
        wrong, expected = np.flatnonzero(numbers <= 0.0), "a number above 0"
    elif place < space.layout.num_inputs:
        wrong, expected = np.flatnonzero(numbers < 0.0), "a number of 0 or more"
    else:
        return
    if len(wrong):
        raise CaseError(file, row_place(wrong[0], column), f"expected {expected}, got {numbers[wrong[0]]:g}.")
