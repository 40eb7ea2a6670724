"""The files of a dataset on disk: entries that appear whole or not at all, whatever kills whom and when.

An entry is a folder of files with a record of their sizes and hashes; it exists if and only if its record matches. Any
number of programs on any number of machines may write into one dataset at once, without locks: each fills a scratch
folder of its own, flushes it, and renames it once. Of two that make the same entry the first one wins.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from pathlib import Path

from ...core import DiskFull, InputError
from ...files import durable
from ...files.disk_errors import disk_sentences, is_full, names_in
from ...stopping import undone_if_stopped, whole_step
from . import faults
from .entry_files import record_in_folder
from .faults import Fault
from .keys import Config, Facts
from .names import PARTS, is_name_of_entry, with_piece
from .record import (
    INDEX,
    KEY,
    KINDS,
    MOST_BYTES,
    QUARANTINE,
    RECORD,
    UNFINISHED,
    Entry,
    Kind,
    Record,
    is_name,
    sealed,
    text_of,
    unsealed,
)
from .shards import Shards, is_stem

TAKEN = errno.EEXIST, errno.ENOTEMPTY
PERHAPS_TAKEN = errno.ENOTDIR, errno.EACCES  # a file stands there; Windows
MOST_KNOWN = 1000
"""Folders that are known to be on the disk."""
TRIES = 10
"""At the place of an entry where others put broken ones all the time."""


class Store:
    """Entries of a dataset by kind (samples, views, lights), name of the folder, and key, which is 24 hex digits."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.shards = Shards(self.folder)
        self._flushed: set[Path] = set()

    def folder_of(self, kind: Kind, name: str) -> Path:
        """Where an entry of this name is, or will be: samples/scene/view_0000/…"""
        return Path(self._place_of(kind, name))

    def _place_of(self, kind: Kind, name: str) -> str:
        """The same as a text, of which a run makes two for each sample."""
        if kind not in KINDS or not is_name_of_entry(name):
            raise ValueError(
                f"{kind} {name!r} is no entry; kinds are {', '.join(KINDS)}, a name is scene/pose/settings."
            )
        return os.path.join(self.folder, kind, name)

    def commit(self, entry: Entry, write: Callable[[Path], object]) -> Record:
        """Make an entry of the files that ``write`` puts into the folder that it is given, all of them or none.

        Nothing is written if the entry exists. A broken one is replaced; where another one has its name, a piece of the
        key is added to it. When this returns, a power cut loses nothing.
        Raises DiskFull and InputError, which name the file's final place, and whatever ``write`` raises; then, and if
        the program is stopped, nothing is left.
        """
        if not KEY.fullmatch(entry.key):
            raise ValueError(f"{entry.key!r} is no key; one has 24 hex digits.")
        if found := self.find(entry):
            return found
        name, there = entry.name, self.record(entry.kind, entry.name)
        if there is not None and there.key != entry.key:
            name = with_piece(name, entry.key)
        final = self.folder_of(entry.kind, name)
        with self._scratch(final) as scratch:
            self._fill(scratch, write)
            _require(scratch, final)
            files = {file: durable.size_and_hash(scratch / file) for file in _written(scratch)}
            record = Record(entry.kind, name, entry.key, files)
            durable.write_new(scratch / RECORD, text_of(record))
            with disk_sentences(final, durable.FOLDER_BYTES):
                durable.flush_folder(
                    scratch, {**record.files, RECORD: durable.size_and_hash(scratch / RECORD)}
                )
                self._publish(scratch, record)
                durable.sync_folder(final.parent)
        return self.find(entry) or record

    @contextmanager
    def _scratch(self, final: Path) -> Iterator[Path]:
        """A folder beside ``final`` that is gone after the block, unless it was renamed."""
        scratch = durable.scratch_name(final.parent)
        remove = partial(durable.remove_folder, scratch)
        with undone_if_stopped(remove):
            try:
                with disk_sentences(final, durable.FOLDER_BYTES), whole_step:
                    self._make_parent(final.parent)
                    durable.make_new(scratch)
                with names_in(final, scratch):
                    yield scratch
            finally:
                with suppress(OSError):
                    remove()

    def _fill(self, scratch: Path, write: Callable[[Path], object]) -> None:
        try:
            write(scratch)
        except OSError as error:  # of a writer that is not one of ours
            if is_full(error):
                raise DiskFull(
                    Path(error.filename or scratch), None, error.strerror or str(error)
                ) from error
            raise

    def _make_parent(self, parent: Path) -> None:
        """Once for each store, also where the folder is there: who made it may not have flushed its name yet."""
        if parent not in self._flushed:
            if len(self._flushed) == MOST_KNOWN:
                self._flushed.clear()
            durable.make_folder(parent, self.folder.parent)
            self._flushed.add(parent)

    def _publish(self, scratch: Path, record: Record) -> None:
        """Rename the scratch folder; what is broken there is moved away, what is not wins."""
        final = self.folder_of(record.kind, record.name)
        for _ in range(TRIES):
            with whole_step:
                try:
                    os.rename(scratch, final)
                    return
                except OSError as error:
                    _require(scratch, final)
                    if error.errno not in (
                        TAKEN + PERHAPS_TAKEN if os.path.lexists(final) else TAKEN
                    ):
                        raise
            if (there := self.record(record.kind, record.name)) is None:
                self.discard(record.kind, record.name)
            elif there.key == record.key:
                return
        raise InputError(
            f"cannot write {final}: something else is put there again and again; find out by what, and run it again."
        )

    def record(self, kind: Kind, name: str) -> Record | None:
        """The record in the folder of this name, whatever its key, if it is valid and all files are there with their
        sizes; contents are not read."""
        return self._of_place(self._place_of(kind, name), kind, name)

    def find(self, entry: Entry) -> Record | None:
        """The record of an entry, whose folder may have a piece of its key at the end; as :meth:`record`."""
        for name in (entry.name, with_piece(entry.name, entry.key)):
            record = self.record(entry.kind, name)
            if record and record.key == entry.key:
                return record
        return None

    def exists(self, entry: Entry) -> bool:
        """Whether an entry is there, by its record and the sizes of its files."""
        return self.find(entry) is not None

    def names(self, kind: Kind) -> Iterator[str]:
        """Names of all folders that stand where entries of a kind stand, broken ones too, sorted."""
        top = os.path.join(self.folder, kind)
        for scene in durable.names_of(top):
            for pose in durable.names_of(f"{top}/{scene}"):
                for settings in durable.names_of(f"{top}/{scene}/{pose}"):
                    if is_name_of_entry(name := f"{scene}/{pose}/{settings}"):
                        yield name

    def scan(self, kind: Kind) -> Iterator[Record]:
        """Records of all entries that exist, sorted by name; at least 10 000 a second from a warm cache."""
        top = os.path.join(self.folder, kind)
        for name in self.names(kind):
            if record := self._of_place(f"{top}/{name}", kind, name):
                yield record

    def _of_place(self, folder: str, kind: Kind, name: str) -> Record | None:
        record = record_in_folder(folder)
        if record is not None and (record.kind, record.name) == (kind, name):
            return record
        return None

    def verify(self, kind: Kind, name: str) -> list[Fault]:
        """Every difference between an entry and its record, all contents read; none if it is as it was written."""
        return faults.of_entry(self.folder_of(kind, name), kind, name)

    def verify_all(
        self, progress: Callable[[int, int], object] | None = None
    ) -> Iterator[Fault]:
        """Faults of all entries, and whatever lies among them and belongs to none.

        progress : called after each entry with the number of those that are done, and of all.
        """
        shards, done = self.shards.all(), 0
        total = len(shards) + sum(1 for kind in KINDS for _ in self.names(kind))
        for kind in KINDS:
            yield from faults.strays(self.folder, kind)
            for name in self.names(kind):
                yield from self.verify(kind, name)
                done += 1
                if progress is not None:
                    progress(done, total)
        yield from faults.strays_of_shards(self.shards.folder)
        for shard in shards:
            yield from faults.of_shard(self.shards.folder, shard)
            done += 1
            if progress is not None:
                progress(done, total)
        for key in self._keys_of_notes():
            if self._note(key) is None:
                yield Fault("quarantine", key, f"{key}.json", "changed")
        yield from faults.strays_beside(self.folder)
        for path in self._unfinished():
            name = path.relative_to(self.folder).as_posix()
            yield Fault("dataset", "", name, "unfinished")

    def discard(self, kind: Kind, name: str) -> None:
        """Remove an entry, broken or not: in one step it is no entry any more."""
        final = self.folder_of(kind, name)
        self._move_away_and_remove(final)

    def remove_lights(self, names: Iterable[str]) -> None:
        """Remove stored lights, which no task needs any more, and the folders that are empty then."""
        for name in names:
            with suppress(InputError):  # of a dataset that is read-only
                self.discard("lights", name)
            for place in islice(self.folder_of("lights", name).parents, PARTS):
                with suppress(OSError):
                    place.rmdir()

    def _move_away_and_remove(self, place: Path) -> None:
        away = durable.scratch_name(place.parent)
        with disk_sentences(place, durable.FOLDER_BYTES):
            try:
                os.rename(place, away)
            except FileNotFoundError:
                return
            durable.remove_folder(away)

    def clean(self, older_s: float = 3600) -> int:
        """Remove what dead programs have left, folders and pages; returns how many that were.

        older_s : a folder in which anything is younger is let alone, because its program may still run, on another
            machine too. One that is not is renamed first: a program that wakes up cannot publish half a folder.
        """
        found = self._unfinished()
        if not found:
            return 0
        latest = durable.clock_of(self.folder) - older_s
        dead = [path for path in found if durable.newest_mtime(path) <= latest]
        for path in dead:
            with suppress(InputError):  # another user's: it is in nobody's way
                self._move_away_and_remove(path)
        return len(dead)

    def _unfinished(self) -> list[Path]:
        """What programs have not finished, or have left when they died: folders, pages, parts of the index, notes."""
        names = durable.names_of(self.folder)
        found = [self.folder / name for name in names if name.startswith(UNFINISHED)]
        for place in (self.folder / kind for kind in KINDS):
            for pose in (
                path for x in durable.names_of(place) for path in _paths_in(place / x)
            ):
                found += [x for x in _paths_in(pose) if x.name.startswith(durable.SCRATCH)]
        shards = self.shards.folder
        pieces = [place for place in _paths_in(shards) if is_stem(place.name)]
        for place in (self.folder / QUARANTINE, self.folder / INDEX, shards, *pieces):
            found += [path for path in _paths_in(place) if path.name.startswith(".")]
        return found

    def quarantine(self, key: str, facts: Config) -> None:
        """Note that a view cannot be made.  facts : plain values, its log for example."""
        path = self._quarantine_of(key)
        self._flushed.discard(path.parent)  # another run may have removed it, empty
        with disk_sentences(path):
            self._make_parent(path.parent)
            durable.write_lasting(path, sealed(json.dumps(facts, ensure_ascii=False)))

    def quarantined(self) -> dict[str, Facts]:
        """Key → facts of all views that cannot be made; a file that is damaged counts for nothing."""
        notes = {key: self._note(key) for key in self._keys_of_notes()}
        return {key: facts for key, facts in notes.items() if facts is not None}

    def _keys_of_notes(self) -> list[str]:
        names = (Path(name) for name in durable.names_of(self.folder / QUARANTINE))
        return [
            name.stem for name in names if name.suffix == ".json" and KEY.fullmatch(name.stem)
        ]

    def _note(self, key: str) -> Facts | None:
        """The facts in a note of quarantine; None where it was changed."""
        try:
            text = unsealed(durable.read_small(os.fspath(self._quarantine_of(key)), MOST_BYTES))
            facts = json.loads(text or "null")
        except (OSError, ValueError, RecursionError):
            return None
        if isinstance(facts, dict):
            return facts
        return None

    def release(self, key: str) -> None:
        """Let a view be tried again."""
        self._move_away_and_remove(self._quarantine_of(key))

    def remove_empty_quarantine(self) -> None:
        """Remove the folder of what could not be made, where nothing is in it."""
        with suppress(OSError):
            (self.folder / QUARANTINE).rmdir()

    def _quarantine_of(self, key: str) -> Path:
        if not KEY.fullmatch(key):
            raise ValueError(f"{key!r} is no key; one has 24 hex digits.")
        return self.folder / QUARANTINE / f"{key}.json"


def _paths_in(folder: Path) -> list[Path]:
    return [folder / name for name in durable.names_of(folder)]


def _require(scratch: Path, final: Path) -> None:
    """Raise InputError if another program has removed the scratch folder."""
    if not scratch.exists():
        raise InputError(
            f"cannot write {final}: another program has removed its unfinished files, because nothing was written for "
            "so long that this one seemed dead; run it again."
        )


def _written(scratch: Path) -> list[str]:
    """Names of the files in a scratch folder. Raises ValueError for what cannot be part of an entry."""
    found = list(durable.plain_files(scratch))
    wrong = [name for name, plain in found if not plain or not is_name(name)]
    if wrong:
        raise ValueError(
            f"an entry has plain files only, none hidden and none called {RECORD}; it got {wrong}."
        )
    return [name for name, _ in found]
