"""The table of a dataset, index.parquet, with a row for each sample, made from the shards alone; and its damage."""

from __future__ import annotations

import hashlib
import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import InputError, nearest
from ..files import durable
from ..files.parquet import Kind, ParquetRows, parquet_bytes
from .file import DatasetFile, Value, read_dataset_text
from .keys import Config, Facts
from .store import INDEX, RECORD, SHARDS, Row, Shard, Store, record_of
from .sweep import possible_values

PLACES: dict[str, Kind] = {
    **dict.fromkeys(("key", "split", "shard"), "text"),
    **dict.fromkeys(("offset", "bytes", "light_offset", "light_bytes", "number"), "integer"),
}
"""First columns: where a sample is."""
EXPOSED: dict[str, Kind] = dict.fromkeys(
    ("exposed_s", "system_gain_dn_per_e", "black_level_dn"), "number"
)
"""Columns on the first frame of a sample: actual time [s], gain K [DN/e-], black level [DN]."""
SEEDS = ("serial", "repetition")
OF_SHARDS = "shards"
"""Name of the text in the file that identifies its shards."""
VALUES_SHOWN_MAX = 20
EQUAL_RELATIVE = 1e-9


class Table(Sequence[Row]):
    """The samples of a dataset, in its order; few rows are in memory. Raises InputError without a dataset."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self._rows = open_table(store)
        self._chosen: NDArray[np.int64] | None = None

    def __getstate__(self) -> dict[str, object]:
        """Pickle without the opened file."""
        return {**vars(self), "_rows": None}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._rows = open_table(self.store)

    def __len__(self) -> int:
        return self._rows.rows if self._chosen is None else len(self._chosen)

    def __getitem__(self, number: int) -> Row:  # type: ignore[override]
        place = range(len(self))[operator.index(number)]
        row = place if self._chosen is None else int(self._chosen[place])
        with self._as_written():
            return _row_of(self._rows.row(row))

    def __iter__(self) -> Iterator[Row]:
        if self._chosen is not None:
            yield from map(self.__getitem__, range(len(self)))
        else:
            with self._as_written():
                yield from map(_row_of, self._rows.all_rows())

    @contextmanager
    def _as_written(self) -> Iterator[None]:
        """Raise InputError if the table cannot be read."""
        try:
            yield
        except (ValueError, KeyError, TypeError):
            raise InputError(
                f"{self.store.folder / INDEX} has changed since it was written; remove it: opening the dataset "
                "recreates it."
            ) from None

    @property
    def digest(self) -> str:
        """SHA-256 of the names of its shards, which hold the hashes of their contents."""
        return self._rows.about[OF_SHARDS]

    @cached_property
    def names(self) -> list[str]:
        """Names of all values of samples, including split and actual exposure."""
        columns = [
            _name_of(x) for x in self._rows.types if x not in PLACES and x not in EXPOSED
        ]
        return ["split", *dict.fromkeys(columns), *EXPOSED]

    def where(self, name: str, value: object) -> Table:
        """Return the rows with this value. Raises InputError for an unknown name, or a value of no row."""
        if name not in self.names:
            raise InputError(
                f"no sample has {name!r}; samples have {', '.join(self.names)}.{nearest(name, self.names)}"
            )
        here = np.zeros(self._rows.rows, bool)
        for values, numbers in self._coded(name):
            here |= np.array([*(_is_equal(x, value) for x in values), False])[numbers]
        if not here.any():
            present = [text or "none" for text in self.counts(name)]
            more = [f"… ({len(present)} values)"] if len(present) > VALUES_SHOWN_MAX else []
            shown = ", ".join(present[:VALUES_SHOWN_MAX] + more)
            near = nearest(value, present) if isinstance(value, str) else ""
            raise InputError(f"{name} is {value!r}; the samples have {shown}.{near}")
        chosen, places = copy(self), np.flatnonzero(here)
        chosen._chosen = (
            places if self._chosen is None else np.intersect1d(places, self._chosen)
        )
        return chosen

    def counts(self, name: str) -> dict[str, int]:
        """Return each value of a name as text → number of its rows."""
        counts = Counter[str]()
        for values, numbers in self._coded(name):
            chosen = numbers if self._chosen is None else numbers[self._chosen]
            each = np.bincount(chosen[chosen >= 0], minlength=len(values)).tolist()
            counts.update({str(x): n for x, n in zip(values, each, strict=True) if n})
        return dict(counts)

    def places(self, beginning: str) -> list[int]:
        """Return the places of the rows whose key starts with this text."""
        ((keys, numbers),) = self._coded("key")
        here = np.array([*(str(x).startswith(beginning) for x in keys), False])[numbers]
        return np.flatnonzero(here if self._chosen is None else here[self._chosen]).tolist()

    def _coded(self, name: str) -> Iterator[tuple[list[object], NDArray[np.int64]]]:
        """Yield, for each kind of values of a name, each value once, and for each row the number of its value (−1:
        none)."""
        with self._as_written():
            for x in self._rows.types:
                if x == name or (x not in PLACES and _name_of(x) == name):
                    yield self._rows.coded(x)


def open_table(store: Store) -> ParquetRows:
    """Return the table of the current shards: index.parquet, or a new one. Raises InputError."""
    path = store.folder / INDEX
    with suppress(ValueError, OSError):
        rows = ParquetRows(path)
        if rows.about.get(OF_SHARDS) == _digest_of(store.finished().values()):
            return rows
    content = _table_bytes(store)
    with suppress(InputError):  # a folder that cannot be written, a full disk
        durable.write_lasting(path, [content])
    return ParquetRows(content)


def _digest_of(shards: Iterable[Shard]) -> str:
    """Return the SHA-256 of the names of shards."""
    return hashlib.sha256("\n".join(sorted(x.name for x in shards)).encode()).hexdigest()


def _table_bytes(store: Store) -> bytes:
    """Return the content of index.parquet. Raises InputError for a changed shard."""
    kinds = kinds_of(read_dataset_text(store.require_record().text))
    shards = store.finished().values()
    order = sorted((min(row.number for row in store.rows(shard)), shard) for shard in shards)
    cells = (
        {name: getattr(row, name) for name in PLACES}
        | row.exposed
        | value_cells(row.values, kinds)
        for _, shard in order
        for row in sorted(store.rows(shard), key=lambda row: row.number)
    )
    try:
        return parquet_bytes(cells, kinds, {OF_SHARDS: _digest_of(shards)})
    except InputError:
        raise
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"the shards of {store.folder} do not match the dataset file in its record ({error}); was the record "
            "changed?"
        ) from None


def value_cells(values: Config, kinds: Mapping[str, Kind]) -> Facts:
    """Return column → cell for the values of a sample."""
    cells: Facts = {}
    for name, value in values.items():
        column = f"{name} ({_kind_of(name, value)})"
        column = column if column in kinds else name
        cells[column] = float(value) if kinds.get(column) == "number" else value
    return cells


def _row_of(cells: Facts) -> Row:
    places = {name: cells.pop(name) for name in PLACES}
    exposed = {name: cells.pop(name) for name in EXPOSED}
    values = {_name_of(column): x for column, x in cells.items() if x is not None}
    return Row.model_construct(**places, exposed=exposed, values=values)


def kinds_of(file: DatasetFile) -> dict[str, Kind]:
    """Return the columns of the table of a dataset and the kinds of their values.

    If a name has values of several kinds, only its numbers have the plain name; other columns are e.g. "NAME (text)",
    like every name that itself ends with a bracket.
    """
    kinds: dict[str, Kind] = {**PLACES, **EXPOSED, "scene": "text", "camera": "text"}
    for name in (*file.varied, "serial"):
        values = possible_values(file, name)
        value_kinds = dict.fromkeys(_kind_of(name, value) for value in values) or {"seed": None}
        is_plain = not name.endswith(")")
        for kind in value_kinds:
            alone = is_plain and (
                len(value_kinds) == 1 or kind in ("integer", "number", "seed")
            )
            kinds[name if alone else f"{name} ({kind})"] = kind
        if is_plain and {"integer", "number"} <= {*value_kinds}:
            kinds[name] = "number"
    if any(scene.views or scene.path for scene in file.scenes):
        kinds |= {"view": "integer", "pose": "pose"}
    if any(scene.has_times for scene in file.scenes):
        kinds["time_s"] = "number"
    if any(scene.sensors is not None for scene in file.scenes):
        kinds["sensor"] = "text"
    return kinds


def _kind_of(name: str, value: Value) -> Kind:
    if name in SEEDS:
        return "seed"
    kinds: dict[type, Kind] = {bool: "flag", int: "integer", float: "number", str: "text"}
    return kinds.get(type(value), "vector")


def _is_equal(cell: object, value: object) -> bool:
    """Return True if a cell has a value; numbers are equal to nine digits."""
    if isinstance(value, float) and isinstance(cell, int | float):
        return math.isclose(value, cell, rel_tol=EQUAL_RELATIVE)
    return cell is not None and bool(cell == ([*value] if isinstance(value, tuple) else value))


def _name_of(column: str) -> str:
    return column.rpartition(" (")[0] if column.endswith(")") else column


class Fault(NamedTuple):
    """A damaged file of the folder."""

    file: str
    what: Literal["changed", "missing"]


def verify(
    store: Store, now: Callable[[int, int], object] = lambda done, total: None
) -> list[Fault]:
    """Return the changed and missing files.  now : called with the number of shards read, and of all shards.

    Raises InputError without a dataset, or for another format.
    """
    store.require_record()
    shards, faults = store.finished(), list[Fault]()
    content = durable.read_small(store.folder / RECORD, 2**26)
    if record_of(content) is None:
        faults.append(Fault(RECORD, "changed" if content else "missing"))
    for number, shard in enumerate(shards.values()):
        now(number, len(shards))
        if not store.is_sound(shard):
            faults.append(Fault(f"{SHARDS}/{shard.name}", "changed"))
    return faults or _faults_of_table(store)


def _faults_of_table(store: Store) -> list[Fault]:
    """Return the fault of the table, which the shards can recreate; an older table is not a fault."""
    path = store.folder / INDEX
    if not path.is_file():
        return [Fault(INDEX, "missing")]
    try:
        table, wanted = ParquetRows(path), ParquetRows(_table_bytes(store))
        if table.about != wanted.about:  # before the rows: they would differ in number
            return []
        pairs = zip(table.all_rows(), wanted.all_rows(), strict=True)
        if table.types == wanted.types and all(row == other for row, other in pairs):
            return []
    except (ValueError, OSError):
        pass
    return [Fault(INDEX, "changed")]


def remove_faults(store: Store, faults: list[Fault]) -> None:
    """Remove changed shards and a changed table, and write the record again."""
    record = store.record()
    for fault in faults:
        if fault.file != RECORD:
            durable.remove_file(store.folder / fault.file)
    if record is not None:
        store.write_record(record)
