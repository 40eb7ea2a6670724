"""Parquet files in memory, and rows and columns of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Row: TypeAlias = dict[str, Any]
"""Name of the column → value."""
Kind: TypeAlias = Literal[
    "flag", "integer", "seed", "number", "text", "vector", "pose", "image", "bytes"
]
"""Of the values of a column; a vector is a list of numbers, a pose has the vectors of POSE, an image the bytes of a
file and its name ("path"), as Hugging Face has it."""
POSE = ("origin_m", "target_m", "up")
GROUP = 500
"""Rows that are read together: one row of a file takes as long as these."""
AT_ONCE = 2048
"""Rows that become Python values at once."""


def parquet_bytes(
    columns: Mapping[str, Sequence[object]], kinds: Mapping[str, Kind], about: Mapping[str, str]
) -> bytes:
    """A file with these columns, in which None is a value that is not there.

    kinds : of each column.  about : texts of the file itself.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: columns[name] for name in kinds}, schema=schema_of(kinds, about))
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, row_group_size=GROUP, compression="zstd")
    return bytes(sink.getvalue())


def schema_of(kinds: Mapping[str, Kind], about: Mapping[str, str]) -> object:
    """Arrow's schema of a file.  kinds : of the columns.  about : texts of the file itself."""
    import pyarrow as pa

    types = [(name, _type_of(kind)) for name, kind in kinds.items()]
    return pa.schema(types, metadata=dict(about))


class ParquetRows:
    """The rows of a file that :func:`parquet_bytes` made; each group of rows is read when it is asked for.

    types : name of each column → that of its values.  about : texts of the file itself.
    Raises ValueError for other bytes.
    """

    def __init__(self, content: bytes) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._file = pq.ParquetFile(pa.BufferReader(content))
        read_group = partial(self._file.read_row_group, use_threads=False)
        self._group = lru_cache(2)(read_group)
        schema, self.rows = self._file.schema_arrow, int(self._file.metadata.num_rows)
        self.types = {field.name: str(field.type) for field in schema}
        texts = schema.metadata or {}
        self.about = {name.decode(): text.decode() for name, text in texts.items()}

    def row(self, number: int) -> Row:
        """One row."""
        group, place = divmod(number, GROUP)
        found: list[Row] = self._group(group).slice(place, 1).to_pylist()
        return found[0]

    def all_rows(self) -> Iterator[Row]:
        """Each row, in order."""
        for batch in self._file.iter_batches(AT_ONCE, use_threads=False):
            yield from batch.to_pylist()

    def coded(self, name: str) -> tuple[list[object], NDArray[np.int64]]:
        """The values of a column, each once, and for each row the number of its own; −1 where there is none."""
        import pyarrow as pa

        column = self._file.read([name], use_threads=False)[name].combine_chunks()
        if pa.types.is_nested(column.type):  # of which Arrow finds no equal ones
            values = column.to_pylist()
            return values, np.arange(len(values))
        codes = column.dictionary_encode()
        numbers = codes.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        return codes.dictionary.to_pylist(), numbers.astype(np.int64)


def _type_of(kind: Kind) -> object:
    import pyarrow as pa

    vector = pa.list_(pa.float64())
    types = {"flag": pa.bool_(), "integer": pa.int64(), "seed": pa.uint64()}
    types |= {"number": pa.float64(), "text": pa.string(), "vector": vector}
    types |= {"bytes": pa.binary()}
    types |= {"image": pa.struct([("bytes", pa.binary()), ("path", pa.string())])}
    return types.get(kind) or pa.struct([(name, vector) for name in POSE])
