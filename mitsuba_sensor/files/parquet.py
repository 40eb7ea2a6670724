"""Parquet files: bytes, rows and columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Row: TypeAlias = dict[str, Any]
"""Name of the column → value."""
Kind: TypeAlias = Literal[
    "flag", "integer", "seed", "number", "text", "vector", "pose", "image", "bytes"
]
"""Kind of values of a column; a vector is a list of numbers, a pose has the vectors of POSE, an image has the bytes of
a file and its name ("path"), as Hugging Face expects."""
POSE = ("origin_m", "target_m", "up")
GROUP = 1000
"""Rows that are read together."""
FORM: dict[str, Any] = {
    "compression": "lz4",
    "use_dictionary": False,
    "write_statistics": False,
    "write_page_checksum": True,
}
"""Format for fast access to single rows; the file is a third larger than the smallest one."""
BATCH_ROWS = 2048
"""Rows that become Python values together."""


def parquet_bytes(
    rows: Iterable[Row], kinds: Mapping[str, Kind], about: Mapping[str, str]
) -> bytes:
    """Return a file with these rows; None, or a name that a row lacks, is a missing value.

    kinds : kind of each column.  about : metadata texts of the file.  Raises ValueError for values of another kind.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema, sink = schema_of(kinds, about), pa.BufferOutputStream()
    with only_value_errors(), pq.ParquetWriter(sink, schema, **FORM) as writer:
        left = iter(rows)
        while group := [*islice(left, GROUP)]:
            writer.write_table(pa.Table.from_pylist(group, schema=schema))
    return bytes(sink.getvalue())


def schema_of(kinds: Mapping[str, Kind], about: Mapping[str, str]) -> object:
    """Return Arrow's schema of a file.  kinds : kind of each column.  about : metadata texts of the file."""
    import pyarrow as pa

    types = [(name, _type_of(kind)) for name, kind in kinds.items()]
    return pa.schema(types, metadata=dict(about))


class ParquetRows:
    """Rows of a file that :func:`parquet_bytes` made, read group by group on demand.

    source : path or content.  types : name of each column → name of its type.  about : metadata texts of the file.
    Raises ValueError for other bytes, now or when rows are read.
    """

    def __init__(self, source: Path | bytes) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        with only_value_errors():
            opened = pa.BufferReader(source) if isinstance(source, bytes) else source
            self._file = pq.ParquetFile(opened, page_checksum_verification=True)
        self._group = lru_cache(2)(partial(_columns_of_group, self._file))
        schema, self.rows = self._file.schema_arrow, int(self._file.metadata.num_rows)
        self.types = {field.name: str(field.type) for field in schema}
        self.about = _texts(schema.metadata)

    def row(self, number: int) -> Row:
        """Return one row."""
        group, place = divmod(number, GROUP)
        with only_value_errors():
            columns = self._group(group)
        return {name: column[place].as_py() for name, column in columns.items()}

    def all_rows(self) -> Iterator[Row]:
        """Yield each row, in order."""
        with only_value_errors():
            for batch in self._file.iter_batches(BATCH_ROWS, use_threads=False):
                yield from batch.to_pylist()

    def coded(self, name: str) -> tuple[list[object], NDArray[np.int64]]:
        """Return the distinct values of a column, and the index of each row's value; −1 for a missing value."""
        import pyarrow as pa

        with only_value_errors():
            column = self._file.read([name], use_threads=False)[name].combine_chunks()
        if pa.types.is_nested(column.type):  # Arrow cannot compare these
            values = column.to_pylist()
            return values, np.arange(len(values))
        codes = column.dictionary_encode()
        numbers = codes.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        return codes.dictionary.to_pylist(), numbers.astype(np.int64)


def _columns_of_group(file: Any, number: int) -> dict[str, Any]:
    """Return name → column of a group of rows.  file : pyarrow.parquet.ParquetFile."""
    table = file.read_row_group(number, use_threads=False)
    return dict(zip(table.column_names, table.columns, strict=True))


@contextmanager
def only_value_errors() -> Iterator[None]:
    """Turn Arrow's errors about invalid files into ValueError."""
    try:
        yield
    except (OSError, NotImplementedError, TypeError) as error:
        raise ValueError(str(error)) from error


def _texts(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """Return the metadata texts of a file, without Arrow's schema."""
    texts = {name.decode(): text.decode() for name, text in (metadata or {}).items()}
    return {name: text for name, text in texts.items() if name != "ARROW:schema"}


def _type_of(kind: Kind) -> object:
    import pyarrow as pa

    vector = pa.list_(pa.float64())
    types = {"flag": pa.bool_(), "integer": pa.int64(), "seed": pa.uint64()}
    types |= {"number": pa.float64(), "text": pa.string(), "vector": vector}
    types |= {"bytes": pa.binary()}
    types |= {"image": pa.struct([("bytes", pa.binary()), ("path", pa.string())])}
    return types.get(kind) or pa.struct([(name, vector) for name in POSE])
