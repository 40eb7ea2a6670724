"""Parquet files in memory, and rows and columns of them."""

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
"""Of the values of a column; a vector is a list of numbers, a pose has the vectors of POSE, an image the bytes of a
file and its name ("path"), as Hugging Face has it."""
POSE = ("origin_m", "target_m", "up")
GROUP = 1000
"""Rows that are read together: one row of a file takes as long as these."""
FORM: dict[str, Any] = {
    "compression": "lz4",
    "use_dictionary": False,
    "write_statistics": False,
    "write_page_checksum": True,
}
"""Of the columns, so that a row is read at once; the file is a third larger than the smallest one."""
AT_ONCE = 2048
"""Rows that become Python values at once."""


def parquet_bytes(
    rows: Iterable[Row], kinds: Mapping[str, Kind], about: Mapping[str, str]
) -> bytes:
    """A file with these rows; None, or no such name, is a value that is not there.

    kinds : of each column.  about : texts of the file itself.  Raises ValueError for values that are of no such kind.
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
    """Arrow's schema of a file.  kinds : of the columns.  about : texts of the file itself."""
    import pyarrow as pa

    types = [(name, _type_of(kind)) for name, kind in kinds.items()]
    return pa.schema(types, metadata=dict(about))


class ParquetRows:
    """The rows of a file that :func:`parquet_bytes` made; each group of rows is read when it is asked for.

    source : its path or content.  types : name of each column → that of its values.  about : texts of the file itself.
    Raises ValueError for other bytes, now or when they are read.
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
        """One row."""
        group, place = divmod(number, GROUP)
        with only_value_errors():
            columns = self._group(group)
        return {name: column[place].as_py() for name, column in columns.items()}

    def all_rows(self) -> Iterator[Row]:
        """Each row, in order."""
        with only_value_errors():
            for batch in self._file.iter_batches(AT_ONCE, use_threads=False):
                yield from batch.to_pylist()

    def coded(self, name: str) -> tuple[list[object], NDArray[np.int64]]:
        """The values of a column, each once, and for each row the number of its own; −1 where there is none."""
        import pyarrow as pa

        with only_value_errors():
            column = self._file.read([name], use_threads=False)[name].combine_chunks()
        if pa.types.is_nested(column.type):  # of which Arrow finds no equal ones
            values = column.to_pylist()
            return values, np.arange(len(values))
        codes = column.dictionary_encode()
        numbers = codes.indices.fill_null(-1).to_numpy(zero_copy_only=False)
        return codes.dictionary.to_pylist(), numbers.astype(np.int64)


def _columns_of_group(file: Any, number: int) -> dict[str, Any]:
    """Name → column of a group of rows.  file : pyarrow's."""
    table = file.read_row_group(number, use_threads=False)
    return dict(zip(table.column_names, table.columns, strict=True))


@contextmanager
def only_value_errors() -> Iterator[None]:
    """Whatever Arrow says of bytes that are no file of Parquet becomes a ValueError."""
    try:
        yield
    except (OSError, NotImplementedError, TypeError) as error:
        raise ValueError(str(error)) from error


def _texts(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    """Of a file, without Arrow's schema."""
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
