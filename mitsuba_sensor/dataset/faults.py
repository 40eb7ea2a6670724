"""Faults of a dataset on disk: how entries differ from their records, and what belongs to no entry."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from ..files import durable
from .names import is_name_of_entry, is_part
from .record import MOST_BYTES, RECORD, Kind, Record, record_of

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
]


class Fault(NamedTuple):
    """One thing that is wrong.

    kind : of entry, dataset for what says what it is, or quarantine for a note there.  name : of the entry, a key in
    quarantine, empty for what belongs to no entry.  file : in the entry's folder, or, of what belongs to no entry, in
    the folder of its kind.
    """

    kind: Kind | Literal["dataset", "quarantine"]
    name: str
    file: str
    what: What


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
    """What lies in the folder of a kind and is no entry; scratch folders of programs that may still run are none."""
    yield from _strays_below(folder / kind, kind, "")


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
