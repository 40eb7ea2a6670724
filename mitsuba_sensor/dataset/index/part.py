"""A part of the index of a dataset: which samples of 10 000 numbers are there, in a Parquet file.

Its name says of which origin and numbers it is, how many samples it has, of how many, and the SHA-256 of its content.
It is whole where it has all: then it was written after the last of its samples was on the disk.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...files.objects import Place, bytes_of, end_of, names_in
from ...files.parquet import Kind, ParquetRows, about_at_end, parquet_bytes
from ..plan.file import DatasetFile
from ..plan.scene_entry import Value
from ..plan.sweep import possible_values
from ..store.keys import Config, Facts
from ..store.names import is_name_of_entry, name_of_view
from ..store.record import INDEX, KEY, sealed, unsealed
from ..store.shard_size import NUMBERS
from ..store.shards import shard_called

FIXED: dict[str, Kind] = {
    "number": "integer",
    "key": "text",
    "name": "text",
    "split": "text",
    "view_key": "text",
    "view_files": "flag",
}
"""Columns of every index, before those of the values."""
TYPES = ("int64", "string", "string", "string", "string", "bool")
"""Of the values of these columns."""
OF_PLACE: dict[str, Kind] = {
    "shard": "text",
    "offset": "integer",
    "bytes": "integer",
    "view_offset": "integer",
}
"""Columns after them where samples are in shards."""
SEEDS = ("serial", "repetition")
ORIGIN_DIGITS = 12
"""Of its SHA-256, in the name of a part."""
_NAME = re.compile(r"([0-9a-f]{12})-(\d{6,9})-(\d{1,5})-of-(\d{1,5})-([0-9a-f]{64})\.parquet")
SPLITS = "splits"
"""Name of the text of a part that says how many samples of each split it has, with a hash of its own."""
REMEDY = "`mitsuba-sensor dataset repair` writes it again"


class InShard(NamedTuple):
    """Where a sample is in a shard.

    shard : name of its file.  offset, bytes : of its members.  view_offset : of the sample that has the files of the
    view, too.
    """

    shard: str
    offset: int
    bytes: int
    view_offset: int | None


class Line(NamedTuple):
    """A row of the index.

    number : of the sample in its dataset.  name : of its folder.  view : key of its view.  view_files : whether that
    has files of its own.  place : in a shard; None where the sample has a folder.
    """

    number: int
    key: str
    name: str
    split: str
    view: str
    view_files: bool
    values: Config
    place: InShard | None = None

    @property
    def view_name(self) -> str:
        """Of the folder of its view."""
        return name_of_view(self.values, self.view)


class Part(NamedTuple):
    """A file of the index.

    origin : the first digits of the SHA-256 of what the dataset is made from.  number : from 0.  rows : samples.
    planned : samples that it has when it is whole.  digest : SHA-256 of its content.
    """

    origin: str
    number: int
    rows: int
    planned: int
    digest: str

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.origin}-{self.number:06d}-{self.rows}-of-{self.planned}-{self.digest}.parquet"

    @property
    def is_whole(self) -> bool:
        """Whether it has all of its samples."""
        return self.rows == self.planned

    @property
    def about(self) -> dict[str, str]:
        """What its content says of itself beside the splits, as its name does."""
        return {"origin": self.origin, "part": str(self.number), "planned": str(self.planned)}


def part_called(name: str) -> Part | None:
    """The part of which a file with this name is; None of any other file."""
    if (found := _NAME.fullmatch(name)) is None:
        return None
    origin, *counts, digest = found.groups()
    number, rows, planned = map(int, counts)
    part = Part(origin, number, rows, planned, digest)
    if part.name == name:  # no more zeros before its numbers
        return part
    return None


def all_parts(folder: Place) -> list[Part]:
    """All parts of a dataset, of whatever origin."""
    parts = (part_called(name) for name in names_in(folder / INDEX))
    return [part for part in parts if part is not None]


def parts_of(origin: str, parts: Iterable[Part]) -> dict[int, Part]:
    """Number → the part of this origin; of several with one number that with most samples."""
    own = [part for part in parts if origin.startswith(part.origin)]
    return {
        part.number: part for part in sorted(own, key=lambda part: (part.number, part.rows))
    }


def kinds_of(file: DatasetFile, in_shards: bool = False) -> dict[str, Kind]:
    """Name of each column of the index of a dataset → the kind of its values.

    in_shards : whether its samples are in shards.
    A name that has values of several kinds has a column for each: its numbers have the name alone, others for example
    "NAME (text)". So has each name that itself ends with a bracket.
    """
    kinds: dict[str, Kind] = {**FIXED}
    if in_shards:
        kinds |= OF_PLACE
    kinds |= {"scene": "text", "camera": "text"}
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
    if isinstance(value, bool):
        return "flag"
    if isinstance(value, int):
        return "integer"
    if isinstance(value, float):
        return "number"
    if isinstance(value, str):
        return "text"
    return "vector"


def part_of(
    origin: str, number: int, lines: Sequence[Line], planned: int, kinds: Mapping[str, Kind]
) -> tuple[Part, bytes]:
    """A part with these lines, and its content.  kinds : of the columns."""
    columns: dict[str, list[object]] = {name: [None] * len(lines) for name in kinds}
    for place, name in enumerate(FIXED):
        columns[name] = [line[place] for line in lines]
    if lines and lines[0].place is not None:
        for name in OF_PLACE:
            columns[name] = [getattr(line.place, name) for line in lines]
    for row, line in enumerate(lines):
        for name, value in line.values.items():
            column, cell = cell_of(name, value, kinds)
            columns[column][row] = cell
    part = Part(origin[:ORIGIN_DIGITS], number, len(lines), planned, "")
    splits = sealed(json.dumps(Counter(line.split for line in lines))).decode()
    content = parquet_bytes(columns, kinds, {**part.about, SPLITS: splits})
    return part._replace(digest=hashlib.sha256(content).hexdigest()), content


def cell_of(name: str, value: Value, kinds: Mapping[str, Kind]) -> tuple[str, Value]:
    """The column that has a value of a sample, and the value as it has it: where a name has values of several kinds,
    the column of its kind."""
    column = f"{name} ({_kind_of(name, value)})"
    if column not in kinds:
        column = name
    if kinds[column] == "number":
        return column, float(value)  # type: ignore[arg-type]
    return column, value


def splits_of(folder: Place, part: Part) -> dict[str, int]:
    """How many samples of each split a part has; only the end of its file is read. Raises InputError."""
    path = folder / INDEX / part.name
    with _as_written(path):
        return _splits_said(part, *about_at_end(partial(end_of, path)))


def _splits_said(part: Part, rows: int, about: Mapping[str, str]) -> dict[str, int]:
    """The samples of each split, as a file says. Raises ValueError where that is not the one of this part."""
    splits = about.get(SPLITS, "")
    if (rows, about) != (part.rows, {**part.about, SPLITS: splits}):
        raise ValueError
    counts: dict[str, int] = json.loads(unsealed(splits.encode()) or "")
    return counts


@contextmanager
def _as_written(path: Place) -> Iterator[None]:
    """A part that cannot be read, or is not as it was written, becomes a sentence."""
    try:
        yield
    except InputError:
        raise
    except ValueError:
        raise _was_changed(path) from None
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror}; if the dataset has changed since it was opened, open it again, "
            f"else {REMEDY}."
        ) from None


def _was_changed(path: Place) -> InputError:
    return InputError(f"{path} was changed; {REMEDY}.")


class OpenPart:
    """What is in a part, which is as it was written. Raises InputError."""

    def __init__(self, folder: Place, part: Part) -> None:
        self.path, self.part = folder / INDEX / part.name, part
        with _as_written(self.path):
            content = bytes_of(self.path)
            if hashlib.sha256(content).hexdigest() != part.digest:
                raise ValueError
            self.rows = ParquetRows(content)
            _splits_said(part, self.rows.rows, self.rows.about)
        self._beside = {*FIXED}
        if "shard" in self.rows.types:
            self._beside |= {*OF_PLACE}
        named = [*self.rows.types.items()][: len(FIXED)]
        if named != [*zip(FIXED, TYPES, strict=True)]:
            raise _was_changed(self.path)

    def line(self, number: int) -> Line:
        """The line in this row."""
        return self._line_of(self.rows.row(number))

    def lines(self) -> Iterator[Line]:
        """All of them, in the order of their numbers."""
        before = -1
        for line in map(self._line_of, self.rows.all_rows()):
            if line.number <= before:
                raise _was_changed(self.path)
            before = line.number
            yield line

    def names(self) -> list[str]:
        """Names of all that has values, split included."""
        return [*dict.fromkeys(map(_name_of, self._columns())), "split"]

    def values(self, name: str) -> Iterator[tuple[list[object], NDArray[np.int64]]]:
        """The values of a name, each once, and for each row the number of its own, −1 for none: of each kind."""
        columns = ["split", *self._columns()]
        return (self.rows.coded(column) for column in columns if _name_of(column) == name)

    def _columns(self) -> list[str]:
        """Columns of values."""
        return [name for name in self.rows.types if name not in self._beside]

    def _line_of(self, row: Facts) -> Line:
        number, key, name, split, view, view_files = (row.pop(name) for name in FIXED)
        start = self.part.number * NUMBERS
        known = None not in (number, key, name, split, view, view_files)
        known = known and bool(KEY.fullmatch(key) and KEY.fullmatch(view))
        if not (known and is_name_of_entry(name) and start <= number < start + NUMBERS):
            raise _was_changed(self.path)
        place = self._place_of(row)
        values = {_name_of(column): x for column, x in row.items() if x is not None}
        return Line(number, key, name, split, view, view_files, values, place)

    def _place_of(self, row: Facts) -> InShard | None:
        """Takes the place of the sample in its shard out of a row."""
        if "shard" not in self._beside:
            return None
        place = InShard(*(row.pop(name) for name in OF_PLACE))
        if (
            shard_called(place.shard or "") is None
            or place.offset is None
            or place.bytes is None
        ):
            raise _was_changed(self.path)
        return place


def _name_of(column: str) -> str:
    if column.endswith(")"):
        return column.rpartition(" (")[0]
    return column
