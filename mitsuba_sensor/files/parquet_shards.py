"""Parquet files of bounded size, NAME-00000-of-00003.parquet, written a few rows at a time."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Self

from .disk_errors import disk_sentences
from .parquet import Kind, Row, schema_of

if TYPE_CHECKING:
    import pyarrow.parquet as pq

MOST_ROWS = 100
"""Of a group, which readers have in memory at once."""
GROUP_BYTES = 2**25


class ParquetShards:
    """Writes rows into shards, of which the last one is closed, and all get their names, at the end.

    name : of the shards.  kinds : of the columns.  about : texts of each file itself.
    most_bytes : of the images and bytes in a shard; a group of rows that is larger has a shard of its own.
    Raises InputError and DiskFull.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        kinds: Mapping[str, Kind],
        about: Mapping[str, str],
        most_bytes: int,
    ) -> None:
        self.folder, self.name, self.most_bytes = folder, name, most_bytes
        self.schema = schema_of(kinds, about)
        self._group: list[Row] = []
        self._group_bytes = self._shard_bytes = 0
        self._shards: list[Path] = []
        self._stack = ExitStack()
        self._writer: pq.ParquetWriter | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        with self._stack:
            if kind is None:
                self._write_group()
        if kind is None:
            for number, path in enumerate(self._shards):
                path.rename(path.with_name(self.name_of(number)))

    def name_of(self, number: int) -> str:
        """Of a shard, when all are written."""
        return f"{self.name}-{number:05d}-of-{len(self._shards):05d}.parquet"

    def add(self, row: Row, size: int) -> None:
        """Append a row.  size : of its images and bytes."""
        if self._group and (
            len(self._group) == MOST_ROWS or self._group_bytes + size > self._most_of_group
        ):
            self._write_group()
        self._group.append(row)
        self._group_bytes += size

    @property
    def _most_of_group(self) -> int:
        return min(GROUP_BYTES, self.most_bytes)

    def _write_group(self) -> None:
        import pyarrow as pa

        writer = self._writer
        if writer is None or self._shard_bytes + self._group_bytes > self.most_bytes:
            writer = self._open_next()
        with disk_sentences(self._shards[-1], self._group_bytes):
            writer.write_table(pa.Table.from_pylist(self._group, schema=self.schema))
        self._shard_bytes += self._group_bytes
        self._group, self._group_bytes = [], 0

    def _open_next(self) -> pq.ParquetWriter:
        import pyarrow.parquet as pq

        self._stack.close()
        path = self.folder / f"{self.name}-{len(self._shards):05d}.parquet"
        self._shards.append(path)
        self._stack.enter_context(disk_sentences(path))
        file = self._stack.enter_context(path.open("wb"))
        writer = pq.ParquetWriter(file, self.schema, compression="zstd")
        self._writer, self._shard_bytes = self._stack.enter_context(writer), 0
        return self._writer
