"""Where the samples of a task are written: each into a folder of its own, or all into a piece of a shard."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Protocol, Self, TypeAlias

from ...files import durable, texts
from ...files.disk_errors import disk_sentences
from ...stopping import undone_if_stopped
from ..plan.configured import PlannedSample
from ..plan.planned import PlannedView
from ..store.keys import Facts
from ..store.record import RECORD, Record, text_of
from ..store.shard_members import member_name
from ..store.shards import Block
from ..store.store import Store

Files: TypeAlias = dict[str, bytes | Facts]
"""Contents by name; facts become JSON."""
Write: TypeAlias = Callable[[Path], Files]
"""Returns files; those that can only be written to a path it puts into the folder that it is given."""
LONGEST_S, MOST_BYTES = 20.0, 2**28
"""After which a piece is closed: a process that is killed loses no more."""


class Place(Protocol):
    """Where the samples of a task are. What was added is there when the block ends, however it ends."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def missing(self) -> list[PlannedSample]:
        """Samples that are not there."""

    def lacks_view(self) -> bool:
        """Whether the files that the samples share are not there, whatever else is."""

    def add_view(self, write: Write) -> object:
        """Write the files that the samples share; before the samples."""

    def add(self, sample: PlannedSample, write: Write) -> object:
        """Write a sample. Raises DiskFull and InputError."""


def place_of(store: Store, view: PlannedView) -> Place:
    """Where the samples of a task are."""
    if view.block is None:
        return FolderPlace(store, view)
    return ShardPlace(store, view, view.block)


class FolderPlace:
    """Samples with a folder each, and a folder of the view."""

    def __init__(self, store: Store, view: PlannedView) -> None:
        self.store, self.view = store, view

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def missing(self) -> list[PlannedSample]:
        """Samples whose folders are not there."""
        return [sample for sample in self.view.samples if not self.store.exists(sample.entry)]

    def lacks_view(self) -> bool:
        """Whether the folder of the view is not there."""
        return bool(self.view.outputs) and not self.store.exists(self.view.entry)

    def add_view(self, write: Write) -> Record:
        """Make the folder of the view."""
        return self.store.commit(self.view.entry, partial(_write_all, write))

    def add(self, sample: PlannedSample, write: Write) -> Record:
        """Make the folder of a sample."""
        return self.store.commit(sample.entry, partial(_write_all, write))


class ShardPlace:
    """Samples in a shard. The files that they share are with the first of them."""

    def __init__(self, store: Store, view: PlannedView, block: Block) -> None:
        self.view, self.shards, self.block = view, store.shards, block
        self._numbers = {one.key: k for k, one in enumerate(view.samples, view.first)}
        self._write_view: Write | None = None
        self._writer = self.shards.writer(block)
        self._stack = ExitStack()
        self._closes_s = 0.0

    def __enter__(self) -> Self:
        with disk_sentences(Path(tempfile.gettempdir()), durable.FOLDER_BYTES):
            folder = tempfile.mkdtemp(prefix="mitsuba-sensor-")
        self._stack.enter_context(undone_if_stopped(partial(shutil.rmtree, folder)))
        self._stack.callback(shutil.rmtree, folder, ignore_errors=True)
        self._stack.enter_context(self._writer)
        self._scratch = Path(folder)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        if len(self.shards.piece_numbers(self.block)) >= self.block.planned:
            self.shards.join(self.block)

    def missing(self) -> list[PlannedSample]:
        """Samples that are in no shard and in no piece."""
        there = self.shards.numbers(self.block)
        return [one for one in self.view.samples if self._numbers[one.key] not in there]

    def lacks_view(self) -> bool:
        """They are there when the first sample is."""
        return False

    def add_view(self, write: Write) -> None:
        """Have the files written with the first sample of the view in its block."""
        if self.view.leads:
            self._write_view = write

    def add(self, sample: PlannedSample, write: Write) -> None:
        """Append a sample."""
        number, view_files = self._numbers[sample.key], dict[str, bytes]()
        files = self._collected(write)
        if self._write_view is not None and number == self.view.first:
            view_files = self._collected(self._write_view)
        facts = {
            name: (len(content), hashlib.sha256(content).hexdigest())
            for name, content in (files | view_files).items()
        }
        members = {member_name(number, name): content for name, content in files.items()}
        for name, content in view_files.items():
            members[member_name(number, name, passed_over=True)] = content
        members[member_name(number, RECORD, passed_over=True)] = text_of(
            Record(*sample.entry, facts)
        )
        self._writer.add(number, members)
        if self._writer.rows == 1:
            self._closes_s = time.monotonic() + LONGEST_S
        if self._writer.size > MOST_BYTES or time.monotonic() > self._closes_s:
            self._writer.close()

    def _collected(self, write: Write) -> dict[str, bytes]:
        """What a writer returns, and what it puts into the scratch folder."""
        files = dict[str, bytes]()
        for name, content in write(self._scratch).items():
            if not isinstance(content, bytes):
                content = texts.short_json(content).encode()
            files[name] = content
        for name, _ in durable.plain_files(self._scratch):
            path = self._scratch / name
            files[name] = durable.read_plain(path)
            durable.remove_file(path)
        return files


def _write_all(write: Write, folder: Path) -> None:
    """Write what a writer returns into the folder."""
    for name, content in write(folder).items():
        if not isinstance(content, bytes):
            content = texts.json_lines(content).encode()
        durable.write_new(folder / name, content)
