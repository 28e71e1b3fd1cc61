"""Files that are bombs, pipes, links to elsewhere, or bring entities."""

import gzip
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from experiments.faults.hostile.place import Place, replace

Hostile = Callable[[Place], None]
BOMB_BYTES = 3 << 30
PIECE = b" " * (1 << 20)
LAUGHS = "".join(f'<!ENTITY l{number} "{f"&l{number - 1};" * 10}">' for number in range(1, 10))
BILLION = f'<!DOCTYPE x [<!ENTITY l0 "ha">{LAUGHS}]>'
NUM_BOMB_ROWS, ROWS_PER_PIECE = 200_000_000, 1_000_000


def document_type(file_of: Callable[[Place], Path], declaration: str, use: str = "") -> Hostile:
    """Return what begins a file with a document type, and uses an entity of it in an id."""

    def make(place: Place) -> None:
        file = file_of(place)
        text = file.read_text(encoding="utf-8").partition("?>")
        body = text[2] if text[1] else text[0]
        body = body.replace('id="', f'id="{use}', 1)
        file.write_text(declaration + body, encoding="utf-8")

    return make


def bomb(file: Path, head: bytes, piece: bytes = PIECE) -> None:
    """Write a packed file that unpacks to gigabytes of the same."""
    with gzip.open(file, "wb", compresslevel=1) as stream:
        stream.write(head)
        for _ in range(BOMB_BYTES // len(piece)):
            stream.write(piece)


def packed_demand(place: Place) -> None:
    """Have a packed bomb for a route file."""
    place.demand.unlink()
    bomb(place.demand.with_name("demand.rou.xml.gz"), b"<routes>")
    replace(place.config, "demand.rou.xml", "demand.rou.xml.gz")


def packed_net(place: Place) -> None:
    """Have a packed bomb for a network."""
    place.net.unlink()
    bomb(place.net.with_name("net.net.xml.gz"), b"<net>")
    replace(place.config, "net.net.xml", "net.net.xml.gz")


def packed_log(place: Place) -> None:
    """Have a packed bomb for a log."""
    columns = list(pd.read_parquet(place.log).columns)
    head, row = (",".join(words).encode() + b"\n" for words in (columns, ["0"] * len(columns)))
    log_of(place, ".csv.gz", lambda file: bomb(file, head, row * (len(PIECE) // len(row))))


def dictionary_log(place: Place) -> None:
    """Have a Parquet file that says its first row hundreds of millions of times."""
    table = pq.read_table(place.log).take(pa.array(np.zeros(ROWS_PER_PIECE, int)))
    with pq.ParquetWriter(place.log, table.schema, compression="zstd") as writer:
        for _ in range(NUM_BOMB_ROWS // ROWS_PER_PIECE):
            writer.write_table(table)


def log_of(place: Place, ending: str, write: Callable[[Path], object]) -> None:
    """Put another kind of file in the place of a log."""
    file = place.log.with_name(f"d01_subject{ending}")
    place.log.unlink()
    write(file)
    replace(place.toml, "d01_subject.parquet", file.name)


def log_at(path: str) -> Hostile:
    """Return what names a file elsewhere as a log."""
    return lambda place: replace(place.toml, "field/d01_subject.parquet", path)


def link_to(target: str, file_of: Callable[[Place], Path] = lambda place: place.log) -> Hostile:
    """Return what puts a link to a file elsewhere in the place of one."""

    def make(place: Place) -> None:
        file = file_of(place)
        file.unlink()
        file.symlink_to(target)

    return make


def pipe(file_of: Callable[[Place], Path]) -> Hostile:
    """Return what puts a pipe to which nobody writes in the place of a file."""

    def make(place: Place) -> None:
        file_of(place).unlink()
        os.mkfifo(file_of(place))

    return make


FILES: Mapping[str, Hostile] = {
    "billion laughs in the configuration": document_type(lambda place: place.config, BILLION, "&l9;"),
    "billion laughs in the route file": document_type(lambda place: place.demand, BILLION, "&l9;"),
    "billion laughs in the network": document_type(lambda place: place.net, BILLION, "&l9;"),
    "external entity": document_type(
        lambda place: place.demand, '<!DOCTYPE x [<!ENTITY p SYSTEM "file:///etc/passwd">]>', "&p;"
    ),
    "external document type": document_type(
        lambda place: place.config, '<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x.dtd">'
    ),
    "packed bomb as route file": packed_demand,
    "packed bomb as network": packed_net,
    "packed bomb as log": packed_log,
    "Parquet bomb as log": dictionary_log,
    "log out of the case": log_at("../../../../../../../../etc/passwd"),
    "log at an absolute place": log_at("/etc/passwd"),
    "link to /etc/passwd as log": lambda place: log_of(place, ".csv", lambda file: file.symlink_to("/etc/passwd")),
    "link to /dev/zero as log": lambda place: log_of(place, ".csv", lambda file: file.symlink_to("/dev/zero")),
    "link to /dev/zero as route file": link_to("/dev/zero", lambda place: place.demand),
    "pipe as log": lambda place: log_of(place, ".csv", os.mkfifo),
    "pipe as route file": pipe(lambda place: place.demand),
    "pipe as case.toml": pipe(lambda place: place.toml),
}
