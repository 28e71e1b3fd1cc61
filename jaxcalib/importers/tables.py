"""Tables of other people's: CSV or Parquet, packed or not, as a data frame."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.importers.data_frame import Frame

LARGEST_BYTES = 8 * 1024**3  # after unpacking, of the columns that are read


def read_table(file: Path, columns: Sequence[str] | None = None) -> Frame:
    """Read a table.

    Args:
        file: .csv, .csv.gz, .txt (separated by commas or blanks), or .parquet.
        columns: those that are wanted; all unless given.

    Raises:
        CaseError: it cannot be read, lacks a column, or is too large for memory.
    """
    name = file.name.lower()
    try:
        if name.endswith(".parquet"):
            table = pyarrow.parquet.read_table(file, columns=None if columns is None else list(columns))
        else:
            options = pyarrow.csv.ConvertOptions(include_columns=columns)
            with pa.input_stream(file, compression="detect") as stream:
                reader = pyarrow.csv.open_csv(stream, convert_options=options)
                batches, size = [], 0
                for batch in reader:
                    size += batch.nbytes
                    if size > LARGEST_BYTES:
                        raise CaseError(file, "", f"expected at most {LARGEST_BYTES >> 30} GiB; cut it into parts.")
                    batches.append(batch)
                table = pa.Table.from_batches(batches, schema=reader.schema)
    except (pa.ArrowException, OSError, KeyError) as error:
        raise CaseError(file, "", f"expected a table that can be read: {shorten(str(error), 150)}.") from None
    if table.num_rows == 0:
        raise CaseError(file, "", "expected rows; there are none.")
    return table.to_pandas()


def with_numbers(file: Path, table: Frame, columns: Sequence[str]) -> Frame:
    """A table whose columns hold numbers, nan where they are empty.

    Raises:
        CaseError: a column is not there, or holds something else.
    """
    numbers = {}
    for column in columns:
        if column not in table:
            has = ", ".join(map(str, table.columns))[:120]
            raise CaseError(file, f"column {column}", f"expected this column; the file has {has}.")
        numbers[column] = pd.to_numeric(table[column], errors="coerce")
        wrong = numbers[column].isna() & table[column].notna() & (table[column].astype(str).str.strip() != "")
        if wrong.any():
            found = quote(str(table[column][wrong].iloc[0]))
            raise CaseError(file, f"column {column}", f"expected numbers, got {found}.")
    return table.assign(**numbers)
