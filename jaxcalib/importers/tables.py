"""Tables of other people's: CSV or Parquet, packed or not, as a data frame."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from jaxcalib.errors import CaseError, shorten
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
