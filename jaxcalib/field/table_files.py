"""Reads one table from .csv, .csv.gz or .parquet: only the columns that are wanted, and never more than a bounded size.

Rows are counted as a text editor shows a CSV file: the header is row 1, the first data row is row 2. Blank lines are
not counted. Parquet files are counted in the same way.
"""

import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.field.size_limit import BoundedStream, SizeLimit, pieces

FIRST_DATA_ROW = 2
LONGEST_TEXT = 1000
Kind = Literal["number", "text"]


@dataclass(frozen=True)
class ColumnTable:
    """The wanted columns of a file."""

    file: Path
    numbers: dict[str, np.ndarray]  # number columns, nan where empty
    # text columns, dictionary-encoded: (index into the words, words); an empty text is a word like others
    texts: dict[str, tuple[np.ndarray, list[str]]]
    num_rows: int  # number of data rows
    extra_columns: tuple[str, ...]  # columns that the file has beside the wanted ones
    shown: Mapping[str, str] = field(default_factory=dict)  # names in messages of columns that the file names otherwise

    def place(self, index: int, column: str) -> str:
        """Name in messages of a value: its row, counted from 0 here, and its column."""
        return row_place(index, self.shown.get(column, column))


def row_place(index: int, column: str = "") -> str:
    """Name in messages of a data row, counted from 0 here."""
    return f"row {index + FIRST_DATA_ROW}" + (f", column {column}" if column else "")


def read_columns(file: Path, columns: Mapping[str, Kind], limit: SizeLimit | None = None) -> ColumnTable:
    """Read the wanted columns of a table.

    Args:
        file: .csv, .csv.gz or .parquet.
        columns: the wanted columns, all of which must be there.
        limit: what the file may grow to.

    Raises:
        CaseError: the file cannot be read, a column is missing or there twice, a row is ragged, a number column holds
            something else or something infinite, or the file unpacks beyond the limit.
    """
    limit = limit or SizeLimit()
    name = file.name.lower()
    try:
        if name.endswith(".parquet"):
            table, extra = _read_parquet(file, columns, limit)
        elif name.endswith((".csv", ".csv.gz")):
            table, extra = _read_csv(file, columns, limit)
        else:
            raise CaseError(file, "", "expected a file that ends in .csv, .csv.gz or .parquet.")
    except (OSError, EOFError, zlib.error) as error:  # gzip.BadGzipFile is an OSError
        reason = getattr(error, "strerror", None) or str(error)
        raise CaseError(file, "", f"expected a file that can be read: {shorten(reason, 150)}.") from None
    numbers, texts = {}, {}
    for column, kind in columns.items():
        if kind == "text":
            encoded = table[column].combine_chunks().fill_null("").dictionary_encode()
            texts[column] = (np.asarray(encoded.indices), encoded.dictionary.to_pylist())
            continue
        numbers[column] = table[column].to_numpy().astype(np.float64)
        infinite = np.flatnonzero(np.isinf(numbers[column]))
        if len(infinite):
            place = row_place(infinite[0], column)
            raise CaseError(file, place, f"expected a finite number, got {numbers[column][infinite[0]]}.")
    return ColumnTable(file, numbers, texts, table.num_rows, extra)


def column_names(file: Path) -> list[str]:
    """Return the names of a table's columns.

    Args:
        file: .csv, .csv.gz or .parquet.

    Raises:
        CaseError: the file cannot be read.
    """
    try:
        if file.name.lower().endswith(".parquet"):
            return list(pyarrow.parquet.read_schema(file).names)
        return _csv_header(file, {}, SizeLimit())
    except (OSError, EOFError, zlib.error, pa.ArrowException) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise CaseError(file, "", f"expected a file that can be read: {shorten(reason, 150)}.") from None


def _open_csv(file: Path, limit: SizeLimit) -> io.BufferedReader:
    is_packed = file.name.lower().endswith(".gz")
    stream = gzip.GzipFile(file) if is_packed else file.open("rb")  # `BoundedStream` closes it
    return io.BufferedReader(BoundedStream(file, stream, limit), 1 << 20)


def _read_csv(file: Path, columns: Mapping[str, Kind], limit: SizeLimit) -> tuple[pa.Table, tuple[str, ...]]:
    header = _csv_header(file, columns, limit)
    extra = _check_header(file, header, columns)
    types = {column: pa.float64() if kind == "number" else pa.string() for column, kind in columns.items()}
    try:
        with _open_csv(file, limit) as stream:
            batches = pyarrow.csv.open_csv(
                stream,
                read_options=pyarrow.csv.ReadOptions(use_threads=False),  # with threads errors do not name the row
                parse_options=pyarrow.csv.ParseOptions(newlines_in_values=False),
                convert_options=pyarrow.csv.ConvertOptions(
                    column_types=types,
                    include_columns=list(columns),
                    null_values=[""],
                    strings_can_be_null=False,
                ),
            )
            # a short text may say many numbers
            table = pa.Table.from_batches(pieces(file, batches, limit.check_bytes), batches.schema)
    except pa.ArrowInvalid as error:
        raise _csv_error(file, header, str(error)) from None
    return table, extra


def _csv_header(file: Path, columns: Mapping[str, Kind], limit: SizeLimit) -> list[str]:
    with _open_csv(file, limit) as stream:
        line = b""
        while not line.strip():  # blank lines are skipped everywhere
            line = stream.readline(1 << 16)
            if not line:
                raise CaseError(file, "", f"expected a header line ({', '.join(columns)}); the file is empty.")
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CaseError(file, row_place(-1), "expected UTF-8 text.") from None
    header = next(csv.reader([text.rstrip("\r\n")]), [])
    for delimiter, name in [(";", '";"'), ("\t", "tabulators"), ("|", '"|"')]:
        if not set(header) & set(columns) and delimiter in text:
            raise CaseError(file, row_place(-1), f'expected columns separated by ",", got {name}.')
    return header


def _check_header(file: Path, header: Sequence[str], columns: Mapping[str, Kind]) -> tuple[str, ...]:
    for column in columns:
        if column not in header:
            names = ", ".join(shorten(name, 30) for name in header)
            raise CaseError(file, f"column {column}", f"expected this column; the file has {names or 'none'}.")
        if list(header).count(column) > 1:
            raise CaseError(file, f"column {column}", "expected this column once, got it twice.")
    return tuple(name for name in header if name not in columns)


def _csv_error(file: Path, header: Sequence[str], message: str) -> CaseError:
    """Say the same as pyarrow in our words."""
    match = re.search(r"Row #(\d+)", message)
    row = f"row {match.group(1)}" if match else ""
    if wrong := re.match(r"In CSV column #(\d+): .*CSV conversion error to \w+: (.*)", message, re.DOTALL):
        column = header[int(wrong.group(1))]
        place = ", ".join(filter(None, [row, f"column {column}"]))
        if "UTF8" in wrong.group(2):
            return CaseError(file, place, "expected UTF-8 text.")
        value = re.sub(r"^invalid value '(.*)'$", r"\1", wrong.group(2), flags=re.DOTALL)
        return CaseError(file, place, f"expected a number or nothing, got {quote(value)}.")
    if ragged := re.search(r"Expected (\d+) columns, got (\d+)", message):
        return CaseError(file, row, f"expected {len(header)} values as in the header, got {ragged.group(2)}.")
    return CaseError(file, row, f"expected a CSV table: {shorten(message, 150)}.")


def _read_parquet(file: Path, columns: Mapping[str, Kind], limit: SizeLimit) -> tuple[pa.Table, tuple[str, ...]]:
    texts = [column for column, kind in columns.items() if kind == "text"]
    types = {column: pa.float64() if kind == "number" else pa.string() for column, kind in columns.items()}
    try:
        schema = pyarrow.parquet.read_schema(file)
        extra = _check_header(file, schema.names, columns)
        for column, kind in columns.items():
            _check_type(file, column, kind, schema.field(column).type)
        table = _read_batches(file, list(columns), texts, limit)
        return pa.table({column: table[column].cast(wanted) for column, wanted in types.items()}), extra
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        if isinstance(error, OSError) and error.errno is not None:  # the file system's own
            raise
        raise CaseError(file, "", f"expected a Parquet table: {shorten(str(error), 150)}.") from None


def _read_batches(file: Path, columns: list[str], texts: list[str], limit: SizeLimit) -> pa.Table:
    """Read a file piece by piece; texts stay dictionaries, for those may be large once and small in memory."""
    with pyarrow.parquet.ParquetFile(file, read_dictionary=texts) as parquet:
        # what is said of numbers is enough to refuse a file by; nothing is read for it
        numbers_bytes = parquet.metadata.num_rows * np.dtype(float).itemsize * (len(columns) - len(texts))
        limit.check_size(file, numbers_bytes)
        batches = parquet.iter_batches(batch_size=1 << 16, columns=columns, use_threads=False)
        read = pieces(file, _with_short_words(file, texts, batches), limit.check_size)
        return pa.Table.from_batches(read, schema=None if read else parquet.schema_arrow)


def _with_short_words(
    file: Path, columns: Sequence[str], batches: Iterable[pa.RecordBatch]
) -> Iterator[pa.RecordBatch]:
    for batch in batches:
        for column in columns:
            _check_words(file, column, batch.column(column))
        yield batch


def _check_words(file: Path, column: str, values: pa.Array) -> None:
    """Refuse long texts: a dictionary holds each only once, so they would unpack beyond any limit."""
    words = values.dictionary if isinstance(values, pa.DictionaryArray) else values
    is_text = pa.types.is_string(words.type) or pa.types.is_large_string(words.type)
    if pa.types.is_string_view(words.type):  # whose lengths Arrow does not tell
        words, is_text = words.cast(pa.large_string()), True
    if not is_text or not len(words):  # whether it is what the column holds is asked elsewhere
        return
    longest = pc.call_function("max", [pc.call_function("binary_length", [words])]).as_py()
    if longest and longest > LONGEST_TEXT:
        raise CaseError(file, f"column {column}", f"expected texts of at most {LONGEST_TEXT} bytes, got {longest}.")


def _check_type(file: Path, column: str, kind: Kind, given: pa.DataType) -> None:
    if pa.types.is_dictionary(given):
        given = given.value_type
    is_number = pa.types.is_integer(given) or pa.types.is_floating(given) or pa.types.is_decimal(given)
    is_text = pa.types.is_string(given) or pa.types.is_large_string(given) or pa.types.is_string_view(given)
    nothing = pa.types.is_null(given)  # a column without any value
    if kind == "number" and not (is_number or nothing):
        raise CaseError(file, f"column {column}", f"expected numbers, got {given}.")
    if kind == "text" and not (is_text or nothing or pa.types.is_integer(given) or pa.types.is_floating(given)):
        raise CaseError(file, f"column {column}", f"expected text or whole numbers, got {given}.")
