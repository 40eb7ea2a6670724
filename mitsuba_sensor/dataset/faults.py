"""Faults of a dataset on disk: how entries differ from their records, and what belongs to no entry."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from ..files import durable
from .record import KEY, MOST_BYTES, RECORD, Kind, Record, record_of

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

    kind : of entry, dataset for what says what it is, or quarantine for a note there.  key : empty for what belongs to
    no entry.  file : in the entry's folder, or, of what belongs to no entry, in the folder of its kind.
    """

    kind: Kind | Literal["dataset", "quarantine"]
    key: str
    file: str
    what: What


def of_entry(folder: Path, kind: Kind, key: str) -> list[Fault]:
    """Every difference between an entry and its record; of an entry without a valid one, that only."""
    record = _record_in(folder, kind, key)
    if not isinstance(record, Record):
        return [Fault(kind, key, RECORD, record)]
    try:
        found = dict(durable.plain_files(folder))
    except OSError:
        return [Fault(kind, key, RECORD, "unreadable")]
    faults = [
        Fault(kind, key, name, "extra")
        for name in found
        if name not in record.files and name != RECORD
    ]
    for name, (size, digest) in record.files.items():
        what = (
            what_is_wrong(folder / name, size, digest)
            if found.get(name, True)
            else "not a plain file"
        )
        faults += [Fault(kind, key, name, what)] if what else []
    return sorted(faults)


def _record_in(folder: Path, kind: Kind, key: str) -> Record | What:
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
    return record if (record.kind, record.key) == (kind, key) else "of another entry"


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
    top = folder / kind
    for prefix in durable.names_of(top):
        here = top / prefix
        if (
            len(prefix) != 2
            or set(prefix) - set("0123456789abcdef")
            or not here.is_dir()
            or here.is_symlink()
        ):
            yield Fault(kind, "", prefix, "stray")
            continue
        for name in durable.names_of(here):
            entry = KEY.fullmatch(name) and name.startswith(prefix)
            if not entry and not name.startswith(durable.SCRATCH):
                yield Fault(kind, "", f"{prefix}/{name}", "stray")
