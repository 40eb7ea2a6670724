"""Random corruptions of entries: flipped bits, lost tails, zeros, swapped files and folders, edited records."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

from dataset_entries import Entry

from mitsuba_sensor.dataset.record import RECORD, Record, record_of, text_of
from mitsuba_sensor.dataset.store import Store

Corruption = Callable[[Store, list[Entry], random.Random], set[Entry]]
"""Spoils one entry or two; returns which verify must name, those that it names by a stray's key of "" included."""


def _a_file(store: Store, entry: Entry, chance: random.Random, least: int = 1) -> Path:
    folder = store.folder_of(*entry)
    return chance.choice(
        [path for path in sorted(folder.iterdir()) if path.stat().st_size >= least]
    )


def _changed(path: Path, content: bytes) -> None:
    if content == path.read_bytes():
        raise AssertionError("nothing was corrupted")
    path.write_bytes(content)


def flip(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """One bit of any file, records included."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance)
    content = bytearray(path.read_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    _changed(path, bytes(content))
    return {entry}


def cut(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """The tail of a file is lost."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance)
    _changed(path, path.read_bytes()[: chance.randrange(path.stat().st_size)])
    return {entry}


def zeros(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """A block of zeros, as file systems leave it after a crash."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance, least=8)
    content = path.read_bytes()
    first = chance.randrange(len(content))
    block = content[first : first + chance.choice([1, 512, 4096])]
    other = bytes(len(block)) if any(block) else b"\1" * len(block)
    _changed(path, content[:first] + other + content[first + len(block) :])
    return {entry}


def longer(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """Bytes behind the end of a file."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance, least=0)
    path.write_bytes(path.read_bytes() + chance.randbytes(chance.randint(1, 5000)))
    return {entry}


def missing(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """A file is deleted, or a folder or a link stands in its place."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance, least=0)
    path.unlink()
    what = chance.randrange(3)
    if what == 1:
        path.mkdir()
    elif what == 2:
        os.symlink("/dev/null", path)
    return {entry}


def extra(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """A file or folder that no writer made."""
    entry = chance.choice(wanted)
    path = store.folder_of(*entry) / chance.choice(
        ["more.tiff", ".frame.tiff.123", "Frame.tiff", "record.json~", "é"]
    )
    if chance.random() < 0.5:
        path.write_bytes(b"")
    else:
        path.mkdir()
    return {entry}


def two_files(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """Two files are swapped, within an entry or between two."""
    one, two = chance.sample(wanted, 2)
    first = _a_file(store, one, chance)
    second = _a_file(store, one if chance.random() < 0.3 else two, chance)
    if chance.random() < 0.5 and (store.folder_of(*two) / first.name).exists():
        second = store.folder_of(*two) / first.name
    contents = first.read_bytes(), second.read_bytes()
    if contents[0] == contents[1]:
        return flip(store, wanted, chance)
    first.write_bytes(contents[1])
    second.write_bytes(contents[0])
    return {one, two} if second.parent != first.parent else {one}


def two_folders(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """Two entries are swapped whole, perhaps a sample and a view."""
    one, two = chance.sample(wanted, 2)
    first, second = store.folder_of(*one), store.folder_of(*two)
    between = first.with_name(".unfinished-between")
    first.rename(between)
    second.rename(first)
    between.rename(second)
    return {one, two}


def moved(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """An entry is copied to another key, to a wrong place or to a name that is none."""
    entry = chance.choice(wanted)
    folder, other = store.folder_of(*entry), f"{entry[1][:2]}{chance.randrange(16**22):022x}"
    place = chance.choice(
        [
            (folder.with_name(other), (entry[0], other)),
            (folder.with_name("ff" + entry[1][2:]), (entry[0], "")),
            (folder.with_name("copy of " + entry[1]), (entry[0], "")),
            (folder.parent.with_name("copies"), (entry[0], "")),
        ]
    )
    shutil.copytree(folder, place[0])
    return {place[1]}


def record(store: Store, wanted: list[Entry], chance: random.Random) -> set[Entry]:
    """A record is edited by someone who knows how its hash is made; or empty, or another entry's, or no JSON."""
    entry, other = chance.sample(wanted, 2)
    path = store.folder_of(*entry) / RECORD
    said = record_of(path.read_bytes())
    assert said is not None
    files, name = dict(said.files), chance.choice(list(said.files))
    size, digest = files.pop(name)
    if (what := chance.randrange(7)) == 0:
        _changed(path, text_of(Record(*entry, files)))
    elif what == 1:
        _changed(
            path,
            text_of(
                Record(*entry, files | {name: (size + chance.choice([-1, 1, 100]), digest)})
            ),
        )
    elif what == 2:
        _changed(path, text_of(Record(*entry, files | {name: (size, digest[::-1])})))
    elif what == 3:
        _changed(path, text_of(Record(*other, said.files)))
    elif what == 4:
        _changed(path, (store.folder_of(*other) / RECORD).read_bytes())
    elif what == 5:
        _changed(
            path,
            json.dumps(json.loads(path.read_bytes()), indent=chance.choice([1, 2])).encode(),
        )
    else:
        _changed(
            path,
            chance.choice(
                [b"", b"{}", b"null", bytes(path.stat().st_size), b"[" * 10**5, b"\xff\xfe"]
            ),
        )
    return {entry}


CORRUPTIONS: tuple[Corruption, ...] = (
    flip, cut, zeros, longer, missing, extra, two_files, two_folders, moved, record
)  # fmt: skip
