"""Reads the columns of a log under our names and in our units, whatever names and units its tables have."""

from collections.abc import Mapping, Set
from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxcalib.case.log_form import MAY_BE_ABSENT, LogColumn
from jaxcalib.errors import CaseError, quote
from jaxcalib.field.size_limit import SizeLimit
from jaxcalib.field.table_files import ColumnTable, Kind, column_names, read_columns


def our_names(file: Path, columns: Mapping[str, LogColumn]) -> list[str]:
    """Names of a table's columns, ours where a column stands for one of ours.

    Args:
        file: the table.
        columns: by our name those of the table.

    Raises:
        CaseError: the file cannot be read.
    """
    names = column_names(file)
    taken = {column.name for column in columns.values()}
    return [*(ours for ours, column in columns.items() if column.name in names), *(n for n in names if n not in taken)]


def read_log_columns(
    file: Path,
    wanted: Mapping[str, Kind],
    columns: Mapping[str, LogColumn],
    absent: Set[str] = frozenset(),
    limit: SizeLimit | None = None,
) -> ColumnTable:
    """Read columns of a log; nan, or an empty text, stands in those that are absent.

    Args:
        file: the table.
        wanted: our names of the columns.
        columns: by our name those of the table; a column that is not there has our name.
        absent: our names of columns that the table does not have.
        limit: what the file may grow to.

    Raises:
        CaseError: see `jaxcalib.field.table_files.read_columns`.
    """
    there: dict[str, Kind] = {ours: kind for ours, kind in wanted.items() if ours not in absent}
    name_of = {ours: columns[ours].name if ours in columns else ours for ours in there}
    _refuse_missing(file, there, name_of)
    kinds: dict[str, Kind] = {}
    for ours, kind in there.items():
        if kinds.setdefault(name_of[ours], kind) != kind:
            raise CaseError(
                file, f"column {name_of[ours]}", "expected to be mapped as text or as numbers, not as both."
            )
    table = read_columns(file, kinds, limit)
    numbers, texts = {}, {}
    for ours, kind in wanted.items():
        if ours not in there:
            if kind == "text":
                texts[ours] = (np.zeros(table.num_rows, np.int64), [""])
            else:
                numbers[ours] = np.full(table.num_rows, np.nan)
        elif kind == "text":
            texts[ours] = table.texts[name_of[ours]]
        else:
            numbers[ours] = _ours(table.numbers[name_of[ours]], columns.get(ours))
    shown = {ours: f"{name} ({ours})" for ours, name in name_of.items() if name != ours}
    return replace(table, numbers=numbers, texts=texts, shown=shown)


def _ours(values: np.ndarray, column: LogColumn | None) -> np.ndarray:
    """Values in our unit; untouched where nothing is to be changed, so that no bit differs."""
    if column is None or (column.factor == 1.0 and column.zero == 0.0):
        return values
    return (values - column.zero) * column.factor


def _refuse_missing(file: Path, there: Mapping[str, Kind], name_of: Mapping[str, str]) -> None:
    names = set(column_names(file))
    for ours in there:
        name = name_of[ours]
        if name not in names and (name != ours or ours in MAY_BE_ABSENT):
            if name != ours:
                todo = f"[log] of case.toml says that it stands for {ours}"
            else:
                todo = f"write absent = [{quote(ours)}] under [log] of case.toml if the log has none"
            has = ", ".join(sorted(names))[:120] or "none"
            raise CaseError(file, f"column {name}", f"expected this column ({todo}); the file has {has}.")
