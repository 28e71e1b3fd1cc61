"""Mutations of the tables of logs: columns, cells, units, ids and rows, in Parquet or in CSV."""

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

Frame = Any  # a data frame; what is taken from one is untyped anyway
LogMutation = Callable[[Frame, np.random.Generator], tuple[Frame, str]]
ODD_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e9, -1e9, 1e-300, -1.0, 0.0, 2**63, 1e15)
ODD_TEXTS = ("", "abc", "-", "NaN", "1,5", "1 m", "٣", "<b>x</b>", "\x1b[31m", "x" * 5000, "=1+1", "null", "1e999")
FACTORS = {"km/h": 3.6, "mph": 2.23694, "ms": 1e3, "feet": 3.28084, "degrees": 57.29578, "sign": -1.0, "km": 1e-3}


def _column(table: Frame, chance: np.random.Generator) -> str:
    return str(table.columns[int(chance.integers(len(table.columns)))])


def _rows(table: Frame, chance: np.random.Generator) -> np.ndarray:
    share = float(chance.choice([0.01, 0.3, 1.0]))
    return chance.random(len(table)) < max(share, 1.5 / max(len(table), 1))


def column_dropped(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Leave out a column."""
    name = _column(table, chance)
    return table.drop(columns=name), f"column {name} dropped"


def column_twice(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Have a column twice."""
    name = _column(table, chance)
    return pd.concat([table, table[[name]]], axis=1), f"column {name} twice"


def column_renamed(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Give a column another name."""
    name = _column(table, chance)
    other = str(chance.choice([name.upper(), f" {name}", "", name.partition("_")[0], "id", "Geschwindigkeit in m/s"]))
    return table.rename(columns={name: other}), f"column {name} is '{other}'"


def columns_exchanged(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Give two columns each other's names."""
    one, other = (str(name) for name in chance.choice(table.columns, 2, replace=False))
    return table.rename(columns={one: other, other: one}), f"columns {one} and {other} exchanged"


def odd_numbers(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Put an odd number into cells."""
    name, value = _column(table, chance), float(chance.choice(ODD_NUMBERS))
    spoilt, where = _in_cells(table, name, object, value, chance)
    return spoilt, f"{value} {where}"


def odd_texts(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Put an odd text into cells."""
    name, value = _column(table, chance), str(chance.choice(ODD_TEXTS))
    spoilt, where = _in_cells(table, name, str, value, chance)
    return spoilt, f"{value[:20]!r} {where}"


def _in_cells(
    table: Frame, name: str, kind: type, value: float | str, chance: np.random.Generator
) -> tuple[Frame, str]:
    rows = _rows(table, chance)
    spoilt = table.copy()
    spoilt[name] = spoilt[name].astype(kind).where(~rows, value)
    return spoilt, f"in {int(rows.sum())} rows of {name}"


def other_type(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Give a column another type."""
    name, kind = _column(table, chance), str(chance.choice(["text", "bool", "time", "int8", "list", "bytes", "null"]))
    spoilt, length = table.copy(), len(table)
    values: dict[str, Any] = {
        "text": table[name].astype(str),
        "bool": np.arange(length) % 2 == 0,
        "time": pd.to_datetime(np.arange(length), unit="s"),
        "int8": (np.arange(length) % 100).astype(np.int8),
        "list": pd.Series([[1.0, 2.0]] * length, index=table.index, dtype=object),
        "bytes": pd.Series([b"\xff\xfe"] * length, index=table.index, dtype=object),
        "null": pd.Series([None] * length, index=table.index, dtype=object),
    }
    spoilt[name] = values[kind]
    return spoilt, f"column {name} as {kind}"


def other_unit(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Give a column in another unit."""
    numbers = [name for name in table.columns if pd.api.types.is_numeric_dtype(table[name])]
    if not numbers:
        return table, ""
    name, unit = str(chance.choice(numbers)), str(chance.choice(list(FACTORS)))
    return table.assign(**{name: table[name] * FACTORS[unit]}), f"column {name} in other units ({unit})"


def offset(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Add the same to a column."""
    numbers = [name for name in table.columns if pd.api.types.is_numeric_dtype(table[name])]
    if not numbers:
        return table, ""
    name, by = str(chance.choice(numbers)), float(chance.choice([1e-3, 0.5, 100.0, 1.7e9, -1e4]))
    return table.assign(**{name: table[name] + by}), f"{by:g} added to {name}"


def constant(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Have one value in all of a column: of ids, all are the same."""
    name = _column(table, chance)
    value = table[name].iloc[0] if len(table) else 0
    return table.assign(**{name: value}), f"column {name} is {value} throughout"


def shuffled(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Have rows in any order."""
    return table.iloc[chance.permutation(len(table))], "rows in any order"


def backwards(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Have rows backwards."""
    return table.iloc[::-1], "rows backwards"


def rows_twice(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Have rows twice."""
    rows = _rows(table, chance)
    return pd.concat([table, table[rows]]), f"{int(rows.sum())} rows twice"


def few_rows(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Have next to no rows."""
    number = int(chance.integers(0, 4))
    return table.iloc[:number], f"{number} rows"


def gap(table: Frame, chance: np.random.Generator) -> tuple[Frame, str]:
    """Leave out a stretch of rows."""
    begin, end = sorted(int(place) for place in chance.integers(0, len(table) + 1, 2))
    return pd.concat([table.iloc[:begin], table.iloc[end:]]), f"rows {begin} to {end} left out"


LOG_MUTATIONS: Mapping[str, LogMutation] = {
    function.__name__: function
    for function in (
        column_dropped, column_twice, column_renamed, columns_exchanged, odd_numbers, odd_texts, other_type, other_unit,
        offset, constant, shuffled, backwards, rows_twice, few_rows, gap,
    )
}  # fmt: skip


def spoil_table(file: Path, mutation: LogMutation, chance: np.random.Generator) -> str:
    """Apply a mutation to a table in its place, and return what it has done."""
    is_parquet = file.name.endswith(".parquet")
    table = pd.read_parquet(file) if is_parquet else pd.read_csv(file)
    spoilt, words = mutation(table, chance)
    if is_parquet:
        pq.write_table(_as_arrow(spoilt), file)
    elif chance.random() < 0.2:
        spoilt.to_csv(file, index=False, sep=";", decimal=",", lineterminator="\r\n", quoting=csv.QUOTE_ALL)
        words += ", with semicolons and decimal commas"
    else:
        spoilt.to_csv(file, index=False)
    return words


def _as_arrow(table: Frame) -> pa.Table:
    """Return a table that may hold the same name twice, and several types in a column."""
    columns = []
    for place in range(table.shape[1]):
        values = table.iloc[:, place]
        try:
            columns.append(pa.array(values, from_pandas=True))
        except (pa.ArrowException, OverflowError):
            columns.append(pa.array(values.astype(str), from_pandas=True))
    return pa.Table.from_arrays(columns, names=[str(name) for name in table.columns])
