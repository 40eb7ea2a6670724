"""Parquet files of bounded size, NAME-00000-of-00003.parquet, written a few rows at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

from .disk_errors import disk_sentences
from .parquet import Kind, Row, schema_of

GROUP_ROWS, GROUP_BYTES = 100, 2**25
"""Largest group of rows, which readers load together."""


def write_parquet_shards(
    folder: Path,
    name: str,
    kinds: Mapping[str, Kind],
    about: Mapping[str, str],
    rows: Iterable[tuple[Row, int]],
    shard_bytes: int,
) -> None:
    """Write rows to shards, which get their names at the end. Raises InputError and DiskFull.

    kinds : kind of each column.  about : metadata texts of each file.  rows : pairs of a row and its size [bytes].
    shard_bytes : size of the rows in a shard; a larger group of rows gets a separate shard.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, paths, used = schema_of(kinds, about), list[Path](), 0
    with ExitStack() as stack:
        for group, size in _groups(rows, min(GROUP_BYTES, shard_bytes)):
            if not paths or used + size > shard_bytes:
                stack.close()
                paths.append(folder / f"{name}-{len(paths):05d}.parquet")
                stack.enter_context(disk_sentences(paths[-1], size))
                file = stack.enter_context(paths[-1].open("wb"))
                writer = pq.ParquetWriter(file, schema, compression="zstd")
                stack.enter_context(writer)
                used = 0
            writer.write_table(pa.Table.from_pylist(group, schema=schema))
            used += size
    for number, path in enumerate(paths):
        path.rename(path.with_name(f"{name}-{number:05d}-of-{len(paths):05d}.parquet"))


def _groups(rows: Iterable[tuple[Row, int]], bytes_max: int) -> Iterator[tuple[list[Row], int]]:
    """Yield groups of rows that are written together, and their sizes [bytes]."""
    group, used = list[Row](), 0
    for row, size in rows:
        if group and (len(group) == GROUP_ROWS or used + size > bytes_max):
            yield group, used
            group, used = [], 0
        group.append(row)
        used += size
    if group:
        yield group, used
