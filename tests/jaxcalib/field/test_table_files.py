"""Tables come in with exact types, and what is wrong with them is said in one line that names the place."""

import gzip
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from jaxcalib.errors import LONGEST_MESSAGE, CaseError
from jaxcalib.field.size_limit import SizeLimit
from jaxcalib.field.table_files import Kind, read_columns, row_place

COLUMNS: Mapping[str, Kind] = {"time_s": "number", "id": "text", "x_m": "number"}


def write(folder: Path, content: bytes, name: str = "t.csv") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


def message(file: Path, limit: SizeLimit | None = None) -> str:
    with pytest.raises(CaseError) as error:
        read_columns(file, COLUMNS, limit)
    assert len(str(error.value)) <= LONGEST_MESSAGE
    assert str(error.value).isprintable()
    return str(error.value)


def test_reads_the_wanted_columns_in_any_order(tmp_path: Path):
    table = read_columns(write(tmp_path, b"x_m,more,id,time_s\n1,a,007,0.5\n,b,NA,1e1\n"), COLUMNS)
    np.testing.assert_array_equal(table.numbers["time_s"], [0.5, 10.0])
    np.testing.assert_array_equal(table.numbers["x_m"], [1.0, np.nan])
    index, words = table.texts["id"]
    assert [words[i] for i in index] == ["007", "NA"]
    assert table.extra_columns == ("more",)
    assert table.num_rows == 2


def test_reads_what_a_spreadsheet_writes(tmp_path: Path):
    table = read_columns(write(tmp_path, b'\xef\xbb\xbf"time_s","id",x_m\r\n"1","",2\r\n\r\n3,b,4\r\n'), COLUMNS)
    np.testing.assert_array_equal(table.numbers["x_m"], [2.0, 4.0])
    assert table.texts["id"][1][table.texts["id"][0][0]] == ""


def test_reads_a_packed_table(tmp_path: Path):
    table = read_columns(write(tmp_path, gzip.compress(b"time_s,id,x_m\n1,a,2\n"), "t.csv.gz"), COLUMNS)
    np.testing.assert_array_equal(table.numbers["x_m"], [2.0])


def test_reads_parquet_with_whole_numbers_as_ids(tmp_path: Path):
    content = pa.table({"id": pa.array([7, 8]), "time_s": pa.array([1, 2]), "x_m": pa.array([0.5, None]), "y": [1, 2]})
    pyarrow.parquet.write_table(content, tmp_path / "t.parquet")
    table = read_columns(tmp_path / "t.parquet", COLUMNS)
    index, words = table.texts["id"]
    assert [words[i] for i in index] == ["7", "8"]
    np.testing.assert_array_equal(table.numbers["time_s"], [1.0, 2.0])
    np.testing.assert_array_equal(table.numbers["x_m"], [0.5, np.nan])
    assert table.extra_columns == ("y",)


def test_reads_parquet_without_rows(tmp_path: Path):
    schema = pa.schema([("time_s", pa.float32()), ("id", pa.string()), ("x_m", pa.float64())])
    pyarrow.parquet.write_table(schema.empty_table(), tmp_path / "t.parquet")
    assert read_columns(tmp_path / "t.parquet", COLUMNS).num_rows == 0


def test_csv_and_parquet_give_the_same(tmp_path: Path):
    content = pa.table({"time_s": [0.1, 0.2], "id": ["b", "a"], "x_m": [1.25, -3.0]})
    pyarrow.parquet.write_table(content, tmp_path / "t.parquet")
    packed = read_columns(tmp_path / "t.parquet", COLUMNS)
    plain = read_columns(write(tmp_path, b"time_s,id,x_m\n0.1,b,1.25\n0.2,a,-3\n"), COLUMNS)
    for column in ("time_s", "x_m"):
        np.testing.assert_array_equal(packed.numbers[column], plain.numbers[column])
    assert [packed.texts["id"][1][i] for i in packed.texts["id"][0]] == ["b", "a"]
    assert [plain.texts["id"][1][i] for i in plain.texts["id"][0]] == ["b", "a"]


HEADER = "expected a header line (time_s, id, x_m); the file is empty."


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", HEADER),
        (b"\n\n", HEADER),
        (b"time_s;id;x_m\n1;a;2\n", 'row 1: expected columns separated by ",", got ";".'),
        (b"time_s\tid\tx_m\n1\ta\t2\n", 'row 1: expected columns separated by ",", got tabulators.'),
        (b"time_s,x_m\n1,2\n", "column id: expected this column; the file has time_s, x_m."),
        (b"time_s,id,x_m,id\n1,a,2,b\n", "column id: expected this column once, got it twice."),
        (b"time_s,id,x_m\n1,a,2\n3,b,far\n", 'row 3, column x_m: expected a number or nothing, got "far".'),
        (b"x_m,id,time_s\n1,a,2\n3,b,NA\n", 'row 3, column time_s: expected a number or nothing, got "NA".'),
        (b"time_s,id,x_m\n1,a,2\n3,b,inf\n", "row 3, column x_m: expected a finite number, got inf."),
        (b"time_s,id,x_m\n1,a,-1e999\n", "row 2, column x_m: expected a finite number, got -inf."),
        (b"time_s,id,x_m\n1,a,2\n3,b\n", "row 3: expected 3 values as in the header, got 2."),
        (b"time_s,id,x_m\n1,a,2,5\n", "row 2: expected 3 values as in the header, got 4."),
        (b"time_s,id,x_m\n1,\xff,2\n", "row 2, column id: expected UTF-8 text."),
        ("time_s,id,x_m\n".encode("utf-16"), "row 1: expected UTF-8 text."),
        (b"time_s,id,x_m\n1,a,\x1b[2J\n", 'row 2, column x_m: expected a number or nothing, got "[2J".'),
        (
            b"time_s,id,x_m\n" + b"1,a,2\n" * 300_000 + b"1,a,x\n",
            'row 300002, column x_m: expected a number or nothing, got "x".',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_says_what_is_wrong_with_a_csv(tmp_path: Path, content: bytes, expected: str):
    assert message(write(tmp_path, content)) == f"t.csv: {expected}"


def test_refuses_other_endings(tmp_path: Path):
    expected = "t.xlsx: expected a file that ends in .csv, .csv.gz or .parquet."
    assert message(write(tmp_path, b"", "t.xlsx")) == expected


def test_refuses_what_is_not_packed(tmp_path: Path):
    assert message(write(tmp_path, b"time_s,id,x_m\n", "t.csv.gz")).startswith(
        "t.csv.gz: expected a file that can be read: Not a gzipped file"
    )


def test_refuses_a_truncated_packed_file(tmp_path: Path):
    rows = b"".join(b"%d,a,%d\n" % (i, i * i) for i in range(2000))
    content = gzip.compress(b"time_s,id,x_m\n" + rows)
    assert message(write(tmp_path, content[: len(content) // 2], "t.csv.gz")).startswith(
        "t.csv.gz: expected a file that can be read: Compressed file ended"
    )


def test_refuses_a_missing_file(tmp_path: Path):
    expected = "none.csv: expected a file that can be read: No such file or directory."
    assert message(tmp_path / "none.csv") == expected


def test_refuses_a_compression_bomb_by_its_ratio(tmp_path: Path):
    content = gzip.compress(b"time_s,id,x_m\n" + b"1,a,2\n" * 1_000_000)
    limit = SizeLimit(ratio_from_bytes=1 << 20)
    assert message(write(tmp_path, content, "t.csv.gz"), limit) == (
        "t.csv.gz: expected to unpack to at most 200 times the file's size."
    )


def test_refuses_what_unpacks_beyond_the_limit(tmp_path: Path):
    content = b"time_s,id,x_m\n" + b"1,a,2\n" * 1000
    assert message(write(tmp_path, content), SizeLimit(unpacked_bytes=1000)) == (
        "t.csv: expected at most 1000 bytes after unpacking."
    )


def test_refuses_a_short_text_that_says_too_many_numbers(tmp_path: Path):
    """Two bytes say a number of eight."""
    content = b"time_s,id,x_m\n" + b"1,,2\n" * 400_000  # two megabytes of text, 6.4 of numbers
    assert message(write(tmp_path, content), SizeLimit(unpacked_bytes=4_000_000)) == (
        "t.csv: expected at most 4000000 bytes after unpacking."
    )
    assert read_columns(write(tmp_path, content), COLUMNS).num_rows == 400_000


def test_nothing_of_a_refused_file_stays_with_the_error(tmp_path: Path):
    """A check keeps its errors until all logs are read."""
    before = pa.total_allocated_bytes()
    file = write(tmp_path, b"time_s,id,x_m\n" + b"1,,2\n" * 3_000_000)
    with pytest.raises(CaseError) as error:
        read_columns(file, COLUMNS, SizeLimit(unpacked_bytes=40_000_000))
    left = pa.total_allocated_bytes() - before  # forty million were read; the reader itself has eight
    assert left < 20_000_000
    assert error.value.__traceback__ is not None


def test_refuses_a_parquet_bomb(tmp_path: Path):
    """One value repeated a million times takes almost no place in the file."""
    num_rows = 1_000_000
    content = pa.table({"time_s": np.zeros(num_rows), "id": ["a"] * num_rows, "x_m": np.zeros(num_rows)})
    pyarrow.parquet.write_table(content, tmp_path / "t.parquet")
    limit = SizeLimit(ratio_from_bytes=1 << 20)
    assert message(tmp_path / "t.parquet", limit) == (
        "t.parquet: expected to unpack to at most 200 times the file's size."
    )


@pytest.mark.parametrize("ids", [pa.array([7.0, 8.0]), pa.array(["7", "8"]).cast(pa.string_view())])
def test_texts_may_be_stored_as_numbers_or_views(tmp_path: Path, ids: pa.Array):
    table = pa.table({"time_s": [1.0, 2.0], "id": ids, "x_m": [1.0, 2.0]})
    pyarrow.parquet.write_table(table, tmp_path / "t.parquet")
    index, words = read_columns(tmp_path / "t.parquet", COLUMNS).texts["id"]
    assert [float(words[i]) for i in index] == [7.0, 8.0]


def test_a_parquet_bomb_is_refused_before_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    num_rows = 1_000_000
    content = pa.table({"time_s": np.zeros(num_rows), "id": ["a"] * num_rows, "x_m": np.zeros(num_rows)})
    pyarrow.parquet.write_table(content, tmp_path / "t.parquet")
    monkeypatch.setattr(pyarrow.parquet.ParquetFile, "iter_batches", lambda *_, **__: pytest.fail("it is read"))
    expected = "t.parquet: expected at most 10000000 bytes after unpacking."
    assert message(tmp_path / "t.parquet", SizeLimit(unpacked_bytes=10_000_000)) == expected


def test_refuses_long_texts_in_parquet(tmp_path: Path):
    pyarrow.parquet.write_table(pa.table({"time_s": [1.0], "id": ["a" * 2000], "x_m": [1.0]}), tmp_path / "t.parquet")
    assert message(tmp_path / "t.parquet") == "t.parquet: column id: expected texts of at most 1000 bytes, got 2000."


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"time_s": ["soon"], "id": ["a"], "x_m": [1.0]}, "column time_s: expected numbers, got string."),
        ({"time_s": [True], "id": ["a"], "x_m": [1.0]}, "column time_s: expected numbers, got bool."),
        (
            {"time_s": [1.0], "id": [[1]], "x_m": [1.0]},
            "column id: expected text or whole numbers, got list<element: int64>.",
        ),
        ({"time_s": [1.0], "id": ["a"]}, "column x_m: expected this column; the file has time_s, id."),
        ({"time_s": [1.0], "id": ["a"], "x_m": [np.inf]}, "row 2, column x_m: expected a finite number, got inf."),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_says_what_is_wrong_with_parquet(tmp_path: Path, content: dict, expected: str):
    pyarrow.parquet.write_table(pa.table(content), tmp_path / "t.parquet")
    assert message(tmp_path / "t.parquet") == f"t.parquet: {expected}"


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" + bytes(100) + b"PAR1", b"time_s,id,x_m\n1,a,2\n"])
def test_refuses_what_is_not_parquet(tmp_path: Path, content: bytes):
    assert message(write(tmp_path, content, "t.parquet")).startswith("t.parquet: expected a Parquet table: ")


def test_rows_are_counted_from_the_header():
    assert row_place(0) == "row 2"
    assert row_place(41, "x_m") == "row 43, column x_m"
