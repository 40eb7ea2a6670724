"""The table of a dataset, ``index.parquet``: a row for each sample, which pandas, DuckDB and Hugging Face read at once.

It is made from the shards alone: from the rows that each has at its end (store.py). It is made again by whatever opens
it and finds it missing, damaged, or of other shards than there are now; where it cannot be written, in memory.

Columns: key, split, shard (name of its file), offset, bytes, light_offset and light_bytes (places in the shard), number
(in the order of the dataset file), exposed_s, system_gain_dn_per_e and black_level_dn (of the first frame), scene,
camera, and a column for everything that varies. A name with values of several kinds has a column for each:
``exposure_s`` holds the numbers, ``exposure_s (text)`` holds ``auto``.
"""

from __future__ import annotations

import hashlib
import math
import operator
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from copy import copy
from functools import cached_property
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from ..core import InputError, nearest
from ..files import durable
from ..files.parquet import GROUP, Kind, ParquetRows, parquet_bytes
from .file import DatasetFile, read_dataset_text
from .keys import Config, Facts
from .scene_entry import Value
from .store import INDEX, Row, Shard, Store
from .sweep import possible_values

PLACES: dict[str, Kind] = {
    "key": "text",
    "split": "text",
    "shard": "text",
    "offset": "integer",
    "bytes": "integer",
    "light_offset": "integer",
    "light_bytes": "integer",
    "number": "integer",
}
"""Columns before those of the values."""
EXPOSED: dict[str, Kind] = {
    "exposed_s": "number",
    "system_gain_dn_per_e": "number",
    "black_level_dn": "number",
}
"""What is known of the first frame of a sample: time [s], gain K [DN/e-], black level [DN]."""
SEEDS = ("serial", "repetition")
OF_SHARDS = "shards"
"""Name of the text of the file that says of which shards it is."""
MOST_SAID = 20  # values, in the sentence on one that no sample has


class Line(NamedTuple):
    """A row of the table.  exposed : see EXPOSED.  Other fields as of a Row (store.py)."""

    key: str
    split: str
    shard: str
    offset: int
    bytes: int
    light_offset: int
    light_bytes: int
    number: int
    exposed: Config
    values: Config


class Table(Sequence[Line]):
    """The samples of a dataset, in its order; few rows are in memory.  Raises InputError where there is no dataset."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self._rows = open_table(store)
        self._chosen: NDArray[np.int64] | None = None

    def __getstate__(self) -> dict[str, object]:
        """For other processes, which open the table again."""
        return {**vars(self), "_rows": None}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        self._rows = open_table(self.store)

    def __len__(self) -> int:
        return self._rows.rows if self._chosen is None else len(self._chosen)

    @overload
    def __getitem__(self, number: int) -> Line: ...

    @overload
    def __getitem__(self, number: slice) -> list[Line]: ...

    def __getitem__(self, number: int | slice) -> Line | list[Line]:
        places = range(len(self))
        if isinstance(number, slice):
            return [self.line(place) for place in places[number]]
        return self.line(places[operator.index(number)])

    def __iter__(self) -> Iterator[Line]:
        if self._chosen is not None:
            yield from map(self.line, range(len(self)))
        else:
            with self._as_written():
                yield from map(_line_of, self._rows.all_rows())

    def line(self, place: int) -> Line:
        """The row at a place."""
        row = place if self._chosen is None else int(self._chosen[place])
        with self._as_written():
            return _line_of(self._rows.row(row))

    @contextmanager
    def _as_written(self) -> Iterator[None]:
        """What cannot be read of the table becomes a sentence. Raises InputError."""
        try:
            yield
        except (ValueError, KeyError, TypeError):
            path = self.store.folder / INDEX
            raise InputError(
                f"{path} is not as it was written; remove it: it is made again when the dataset is opened."
            ) from None

    @property
    def digest(self) -> str:
        """SHA-256 of the names of the shards that it is of, which hold the hashes of their contents."""
        return self._rows.about[OF_SHARDS]

    @cached_property
    def names(self) -> list[str]:
        """Names of all that has values, split included."""
        columns = [x for x in self._rows.types if x not in PLACES and x not in EXPOSED]
        return ["split", *dict.fromkeys(map(_name_of, columns))]

    def where(self, name: str, value: object) -> Table:
        """The rows that have this value. Raises InputError, with what there is, where there are none in the dataset."""
        if name not in self.names:
            raise InputError(
                f"no sample has {name!r}; what they have: {', '.join(self.names)}.{nearest(name, self.names)}"
            )
        here = np.zeros(self._rows.rows, bool)
        for values, numbers in self._coded(name):
            here |= np.array([*(is_equal(x, value) for x in values), False])[numbers]
        if not here.any():
            known = [text or "none" for text in self.counts(name)]
            shown = known[:MOST_SAID] + (
                [f"… ({len(known)} values)"] if len(known) > MOST_SAID else []
            )
            raise InputError(
                f"{name} is {value!r}; the samples have {', '.join(shown)}.{nearest(str(value), known)}"
            )
        chosen = copy(self)
        places = np.flatnonzero(here)
        chosen._chosen = (
            places if self._chosen is None else np.intersect1d(places, self._chosen)
        )
        return chosen

    def counts(self, name: str) -> dict[str, int]:
        """Each value of a name, or of a column, as text → how many rows have it."""
        found = Counter[str]()
        for values, numbers in self._coded(name):
            chosen = numbers if self._chosen is None else numbers[self._chosen]
            each = np.bincount(chosen[chosen >= 0], minlength=len(values)).tolist()
            found.update({str(x): n for x, n in zip(values, each, strict=True) if n})
        return dict(found)

    def places(self, column: str, beginning: str) -> list[int]:
        """Places of the rows of which this column, of texts, begins so."""
        with self._as_written():
            values, numbers = self._rows.coded(column)
        here = np.array([*(str(x).startswith(beginning) for x in values), False])[numbers]
        return np.flatnonzero(here if self._chosen is None else here[self._chosen]).tolist()

    def _coded(self, name: str) -> Iterator[tuple[list[object], NDArray[np.int64]]]:
        """The values of a name, each once, and for each row the number of its own, −1 for none: of each kind."""
        columns = [
            x
            for x in self._rows.types
            if x == name or (x not in PLACES and _name_of(x) == name)
        ]
        with self._as_written():
            return iter([*map(self._rows.coded, columns)])


def open_table(store: Store) -> ParquetRows:
    """The table of what is there now: index.parquet, or made again. Raises InputError."""
    path, shards = store.folder / INDEX, store.finished()
    with suppress(ValueError, OSError):
        rows = ParquetRows(path)
        if rows.about.get(OF_SHARDS) == digest_of(shards.values()):
            return rows
    content = table_bytes(store)
    with suppress(InputError):  # a folder that cannot be written, a full disk
        durable.write_lasting(path, [content])
    return ParquetRows(content)


def digest_of(shards: Iterable[Shard]) -> str:
    """SHA-256 of the names of shards."""
    return hashlib.sha256(
        "\n".join(sorted(shard.name for shard in shards)).encode()
    ).hexdigest()


def table_bytes(store: Store) -> bytes:
    """The content of index.parquet. Raises InputError for a shard that is not as it was written."""
    kinds = kinds_of(read_dataset_text(store.require_record().text))
    shards = store.finished()
    order = sorted(
        (min(row.number for row in store.rows(shard)), shard) for shard in shards.values()
    )
    about = {OF_SHARDS: digest_of(shards.values())}
    try:
        return parquet_bytes(_groups(store, [shard for _, shard in order], kinds), kinds, about)
    except InputError:
        raise
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(
            f"the shards of {store.folder} are not of the dataset file in its record ({error}); was it changed?"
        ) from None


def _groups(
    store: Store, shards: Sequence[Shard], kinds: Mapping[str, Kind]
) -> Iterator[dict[str, list[object]]]:
    """Columns of a thousand rows after another."""
    group: list[Facts] = []
    for shard in shards:
        for row in sorted(store.rows(shard), key=lambda row: row.number):
            group.append(_cells(row, shard, kinds))
            if len(group) == GROUP:
                yield {name: [cells.get(name) for cells in group] for name in kinds}
                group.clear()
    yield {name: [cells.get(name) for cells in group] for name in kinds}


def _cells(row: Row, shard: Shard, kinds: Mapping[str, Kind]) -> Facts:
    """Column → cell of a sample."""
    exposed = dict(zip(EXPOSED, row.exposed.values(), strict=True))
    places = {**row.model_dump(include={*PLACES}), "shard": shard.name, **exposed}
    return places | value_cells(row.values, kinds)


def value_cells(values: Config, kinds: Mapping[str, Kind]) -> Facts:
    """Column → cell of the values of a sample."""
    cells: Facts = {}
    for name, value in values.items():
        column = f"{name} ({_kind_of(name, value)})"
        column = column if column in kinds else name
        cells[column] = float(value) if kinds.get(column) == "number" else value
    return cells


def _line_of(row: Facts) -> Line:
    places = {name: row.pop(name) for name in PLACES}
    exposed = {name: row.pop(name) for name in EXPOSED}
    values = {_name_of(column): x for column, x in row.items() if x is not None}
    return Line(**places, exposed=exposed, values=values)


def kinds_of(file: DatasetFile) -> dict[str, Kind]:
    """Name of each column of the table of a dataset → the kind of its values.

    Where a name has values of several kinds, its numbers have the name alone, others for example "NAME (text)". So has
    each name that itself ends with a bracket.
    """
    kinds: dict[str, Kind] = {**PLACES, **EXPOSED, "scene": "text", "camera": "text"}
    for name in (*file.varied, "serial"):
        values = [*possible_values(file, name)] or [1]
        found = dict.fromkeys(_kind_of(name, value) for value in values)
        bare = not name.endswith(")")
        for kind in found:
            alone = bare and (len(found) == 1 or kind in ("integer", "number", "seed"))
            kinds[name if alone else f"{name} ({kind})"] = kind
        if bare and {"integer", "number"} <= {*found}:
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


def is_equal(own: object, value: object) -> bool:
    """Whether a value of a sample is the one that is asked for; numbers are equal to nine digits."""
    if isinstance(value, float) and isinstance(own, int | float):
        return math.isclose(value, own, rel_tol=1e-9)
    return own is not None and bool(own == ([*value] if isinstance(value, tuple) else value))


def _name_of(column: str) -> str:
    return column.rpartition(" (")[0] if column.endswith(")") else column
