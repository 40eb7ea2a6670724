"""Faults of a dataset on disk: how entries differ from their records, and what belongs to no entry."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from ...files import durable
from .names import is_name_of_entry, is_part
from .record import (
    KEY,
    MOST_BYTES,
    OF_FOLDER,
    QUARANTINE,
    RECORD,
    UNFINISHED,
    Kind,
    Record,
    record_of,
)
from .shard_members import damaged_samples
from .shards import Shard, is_stem, shard_called

OF_ENTRY = 2
"""Folders above the one of an entry: scene and pose."""
What: TypeAlias = Literal[
    "missing",
    "extra",
    "short",
    "long",
    "changed",
    "unreadable",
    "not a plain file",
    "of another entry",
    "stray",
    "not of the dataset",
    "unfinished",
    "another version",
]
NO_DAMAGE = "not of the dataset", "unfinished", "another version"
"""What is said of a dataset of which every file is as it was written."""
OfDataset: TypeAlias = Literal["shards", "dataset", "quarantine", "source", "library"]


class Fault(NamedTuple):
    """One thing that is not as it was written, or that a user should know.

    kind : of entry, shards, dataset for what says what it is, quarantine for a note there, source for a file that the
    samples are made from, or library for what made them.  name : of the entry or shard, a key in quarantine; of a
    source, what is made from it; else empty.  file : in the entry's folder or in the shard, or, of what belongs to
    none, in the folder of its kind; of a source below the roots.
    """

    kind: Kind | OfDataset
    name: str
    file: str
    what: What

    @property
    def is_damage(self) -> bool:
        """Whether what it is of is not as it was; sources need not be where a dataset is read."""
        return self.what not in NO_DAMAGE and (self.kind, self.what) != ("source", "missing")


def of_entry(folder: Path, kind: Kind, name: str) -> list[Fault]:
    """Every difference between an entry and its record; of an entry without a valid one, that only."""
    record = _record_in(folder, kind, name)
    if not isinstance(record, Record):
        return [Fault(kind, name, RECORD, record)]
    try:
        found = dict(durable.plain_files(folder))
    except OSError:
        return [Fault(kind, name, RECORD, "unreadable")]
    faults = [
        Fault(kind, name, file, "extra")
        for file in found
        if file not in record.files and file != RECORD
    ]
    for file, (size, digest) in record.files.items():
        what: What | None = "not a plain file"
        if found.get(file, True):
            what = what_is_wrong(folder / file, size, digest)
        if what:
            faults.append(Fault(kind, name, file, what))
    return sorted(faults)


def _record_in(folder: Path, kind: Kind, name: str) -> Record | What:
    """The record of an entry, or what is wrong with it."""
    path = folder / RECORD
    if folder.is_symlink() or path.is_symlink():
        return "not a plain file"
    try:
        record = record_of(durable.read_small(os.fspath(path), MOST_BYTES))
    except (FileNotFoundError, NotADirectoryError):
        return "missing"
    except OSError:
        return "unreadable"
    if record is None:
        return "unreadable"
    if (record.kind, record.name) != (kind, name):
        return "of another entry"
    return record


def what_is_wrong(path: Path, size: int, digest: str) -> What | None:
    """What is wrong with a file that was written with this size and SHA-256; None if nothing is."""
    try:
        if path.is_symlink():
            return "not a plain file"
        there = path.lstat().st_size
        if there != size:
            return "short" if there < size else "long"
        return None if durable.sha256_of(path) == digest else "changed"
    except FileNotFoundError:
        return "missing"
    except OSError:
        return "unreadable"


def strays(folder: Path, kind: Kind) -> Iterator[Fault]:
    """What lies in the folder of a kind and is no entry, but for scratch folders of programs that may still run."""
    top = folder / kind
    if os.path.lexists(top) and (top.is_symlink() or not top.is_dir()):
        yield Fault("dataset", "", kind, "stray")
    else:
        yield from _strays_below(top, kind, "")


def _strays_below(top: Path, kind: Kind, above: str) -> Iterator[Fault]:
    """What is no folder of entries, or no entry, in the folder of a scene or pose.  above : its name, with a slash."""
    depth = above.count("/")
    for name in durable.names_of(top / above):
        place = top / above / name
        if depth == OF_ENTRY:
            if not is_name_of_entry(above + name) and not name.startswith(durable.SCRATCH):
                yield Fault(kind, "", above + name, "stray")
        elif is_part(name) and place.is_dir() and not place.is_symlink():
            yield from _strays_below(top, kind, f"{above}{name}/")
        else:
            yield Fault(kind, "", above + name, "stray")


def strays_beside(folder: Path) -> Iterator[Fault]:
    """What lies in the folder of a dataset, or in that of its quarantine, and is nothing of the dataset."""
    for name in durable.names_of(folder):
        if name not in OF_FOLDER and not name.startswith(UNFINISHED):
            yield Fault("dataset", "", name, "not of the dataset")
    for name in durable.names_of(folder / QUARANTINE):
        key, _, end = name.partition(".")
        if not (KEY.fullmatch(key) and end in ("json", "log")) and not name.startswith("."):
            yield Fault("quarantine", "", name, "not of the dataset")


def of_shard(folder: Path, shard: Shard) -> list[Fault]:
    """What is not as it was written of a shard, sample by sample as far as they can be told apart."""
    path = folder / shard.name
    try:
        if path.is_symlink() or not path.is_file():
            return [Fault("shards", shard.name, "", "not a plain file")]
        if durable.sha256_of(path) == shard.digest:
            return []
        changed = damaged_samples(path)
    except OSError:
        return [Fault("shards", shard.name, "", "unreadable")]
    return [Fault("shards", shard.name, name, "changed") for name in changed or [""]]


def strays_of_shards(folder: Path) -> Iterator[Fault]:
    """What lies among shards and is none; pieces of those that are not whole are unfinished."""
    for name in durable.names_of(folder):
        if is_stem(name):
            yield Fault("shards", "", name, "unfinished")
        elif shard_called(name) is None and not name.startswith(durable.SCRATCH):
            yield Fault("shards", "", name, "stray")
