"""Blocks become the one table of a sweep, after nothing is missing."""

import json
import shutil
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from jaxcalib.errors import CaseError
from jaxcalib.runs.disk import writing_to
from jaxcalib.sweeps.store import METADATA_KEY, SweepStore
from sim_adapters.atomic_file import write_atomically

ROW_GROUP = 4096


def missing_blocks(store: SweepStore, description: dict[str, Any]) -> list[int]:
    """Return the blocks that are not there as a whole."""
    num_blocks = int(description["num_blocks"])
    done = store.finished(lambda block: rows_in(description, block), num_blocks)
    return [block for block in range(num_blocks) if block not in done]


def rows_in(description: dict[str, Any], block: int) -> int:
    """Return the number of rows of a block."""
    size, total = int(description["block_rows"]), int(description["num_rows"])
    return min(size, total - block * size)


def merge(store: SweepStore, description: dict[str, Any]) -> None:
    """Write the table, with what was written down of the sweep as its metadata, and remove the blocks.

    Raises:
        CaseError: blocks are missing.
        ResourceError: the disk is full.
    """
    missing = missing_blocks(store, description)
    if missing:
        rows = sum(rows_in(description, block) for block in missing)
        raise CaseError(
            store.table, "", f"expected all {description['num_rows']} rows, {rows} are missing: blocks "
            f"{_ranges(missing)} of {description['num_blocks']}{_of_shards(store, missing)}. Run these first.",
        )  # fmt: skip
    with writing_to(store.table.parent):
        write_atomically(store.table, lambda stream: _write(store, description, stream))
    remove_blocks(store)


def remove_blocks(store: SweepStore) -> None:
    """Remove the blocks of a sweep whose table is there."""
    shutil.rmtree(store.folder, ignore_errors=True)


def _write(store: SweepStore, description: dict[str, Any], stream: IO[bytes]) -> None:
    num_rows, waiting = 0, []
    writer = None
    try:
        for block in range(int(description["num_blocks"])):
            waiting.append(pq.ParquetFile(store.file_of(block)).read())
            is_last = block + 1 == int(description["num_blocks"])
            if sum(table.num_rows for table in waiting) >= ROW_GROUP or is_last:
                table = pa.concat_tables(waiting).unify_dictionaries()
                if writer is None:
                    writer = pq.ParquetWriter(stream, _schema(table.schema, description), compression="zstd")
                writer.write_table(table.cast(writer.schema), row_group_size=table.num_rows)
                num_rows, waiting = num_rows + table.num_rows, []
    finally:
        if writer is not None:
            writer.close()
    if num_rows != int(description["num_rows"]):
        raise RuntimeError(f"expected {description['num_rows']} rows, wrote {num_rows}")


def _schema(schema: pa.Schema, description: dict[str, Any]) -> pa.Schema:
    return schema.with_metadata({METADATA_KEY: json.dumps(description).encode()})


def _ranges(blocks: list[int]) -> str:
    """Return numbers such as 3-5, 9; the first few of them."""
    parts: list[list[int]] = []
    for block in blocks:
        if parts and block == parts[-1][1] + 1:
            parts[-1][1] = block
        else:
            parts.append([block, block])
    said = [f"{low}" if low == high else f"{low}-{high}" for low, high in parts[:8]]
    return ", ".join([*said, "..."] if len(parts) > 8 else said)


def _of_shards(store: SweepStore, missing: list[int]) -> str:
    """Return whose blocks are missing, where all jobs agree on their number."""
    counts = store.shard_counts()
    if len(counts) != 1 or counts == {1}:
        return ""
    (count,) = counts
    numbers = sorted({block % count + 1 for block in missing})
    return f" (shards {_ranges(numbers)} of {count})"
