"""Random corruptions of entries: flipped bits, lost tails, zeros, swapped files and folders, edited records."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

from mitsuba_sensor.dataset.store.record import RECORD, Entry, Kind, Record, record_of, text_of
from mitsuba_sensor.dataset.store.store import Store

Named = set[tuple[Kind, str]]
"""Kinds and names of entries; no name is that of a stray."""
Corruption = Callable[[Store, list[Entry], random.Random], Named]
"""Spoils one entry or two; returns which verify must name."""


def _place(store: Store, entry: Entry) -> Path:
    return store.folder_of(entry.kind, entry.name)


def _a_file(store: Store, entry: Entry, chance: random.Random, least: int = 1) -> Path:
    folder = _place(store, entry)
    return chance.choice(
        [path for path in sorted(folder.iterdir()) if path.stat().st_size >= least]
    )


def _changed(path: Path, content: bytes) -> None:
    if content == path.read_bytes():
        raise AssertionError("nothing was corrupted")
    path.write_bytes(content)


def put_something_else(path: Path, chance: random.Random) -> None:
    """Delete a file, or put a folder or a link in its place."""
    path.unlink()
    what = chance.randrange(3)
    if what == 1:
        path.mkdir()
    elif what == 2:
        os.symlink("/dev/null", path)


def flip(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """One bit of any file, records included."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance)
    content = bytearray(path.read_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    _changed(path, bytes(content))
    return {entry[:2]}


def cut(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """The tail of a file is lost."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance)
    _changed(path, path.read_bytes()[: chance.randrange(path.stat().st_size)])
    return {entry[:2]}


def zeros(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """A block of zeros, as file systems leave it after a crash."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance, least=8)
    content = path.read_bytes()
    first = chance.randrange(len(content))
    block = content[first : first + chance.choice([1, 512, 4096])]
    other = bytes(len(block)) if any(block) else b"\1" * len(block)
    _changed(path, content[:first] + other + content[first + len(block) :])
    return {entry[:2]}


def longer(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """Bytes behind the end of a file."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance, least=0)
    path.write_bytes(path.read_bytes() + chance.randbytes(chance.randint(1, 5000)))
    return {entry[:2]}


def missing(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """A file is deleted, or a folder or a link stands in its place."""
    entry = chance.choice(wanted)
    path = _a_file(store, entry, chance, least=0)
    put_something_else(path, chance)
    return {entry[:2]}


def extra(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """A file or folder that no writer made."""
    entry = chance.choice(wanted)
    path = _place(store, entry) / chance.choice(
        ["more.tiff", ".frame.tiff.123", "Frame.tiff", "record.json~", "é"]
    )
    if chance.random() < 0.5:
        path.write_bytes(b"")
    else:
        path.mkdir()
    return {entry[:2]}


def two_files(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """Two files are swapped, within an entry or between two."""
    one, two = chance.sample(wanted, 2)
    first = _a_file(store, one, chance)
    second = _a_file(store, one if chance.random() < 0.3 else two, chance)
    if chance.random() < 0.5 and (_place(store, two) / first.name).exists():
        second = _place(store, two) / first.name
    contents = first.read_bytes(), second.read_bytes()
    if contents[0] == contents[1]:
        return flip(store, wanted, chance)
    first.write_bytes(contents[1])
    second.write_bytes(contents[0])
    return {one[:2], two[:2]} if second.parent != first.parent else {one[:2]}


def two_folders(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """Two entries are swapped whole, perhaps a sample and a view."""
    one, two = chance.sample(wanted, 2)
    first, second = _place(store, one), _place(store, two)
    between = first.with_name(".unfinished-between")
    first.rename(between)
    second.rename(first)
    between.rename(second)
    return {one[:2], two[:2]}


def moved(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """An entry is copied to another key, to a wrong place or to a name that is none."""
    entry = chance.choice(wanted)
    folder, kind = _place(store, entry), entry.kind
    pose, other = entry.name.rpartition("/")[0], f"{chance.randrange(16**24):024x}"
    place = chance.choice(
        [
            (folder.with_name(other), (kind, f"{pose}/{other}")),
            (folder.parent.with_name("view_9999") / other, (kind, f"scene/view_9999/{other}")),
            (folder.with_name("copy of " + folder.name), (kind, "")),
            (folder.parent.parent.with_name("copies of it"), (kind, "")),
        ]
    )
    shutil.copytree(folder, place[0])
    return {place[1]}


def record(store: Store, wanted: list[Entry], chance: random.Random) -> Named:
    """A record is edited by someone who knows how its hash is made; or empty, or another entry's, or no JSON."""
    entry, other = chance.sample(wanted, 2)
    path = _place(store, entry) / RECORD
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
        _changed(path, (_place(store, other) / RECORD).read_bytes())
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
    return {entry[:2]}


CORRUPTIONS: tuple[Corruption, ...] = (
    flip, cut, zeros, longer, missing, extra, two_files, two_folders, moved, record
)  # fmt: skip
