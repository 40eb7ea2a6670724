"""The files of a sample or of a view, read alike from a folder of its own and from a shard."""

from __future__ import annotations

import hashlib
import io
import os
import stat
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, Protocol

from ...core import InputError
from ...files import durable
from ...files.objects import ByteRange, Place, opened
from ...files.tar_members import content_of
from .record import MOST_BYTES, RECORD, Record, record_of
from .shard_members import Group, group_at

CHANGED = "`mitsuba-sensor dataset verify` finds what is missing or was changed"
MADE_AGAIN = "`mitsuba-sensor dataset repair` makes it again"


class EntryFiles(Protocol):
    """Files by name."""

    def place(self, name: str) -> str:
        """What a sentence calls the place of a file."""

    @property
    def folder(self) -> Path:
        """The folder that has them. Raises InputError where they are in a shard."""

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""

    def sizes(self) -> dict[str, int]:
        """Bytes of each file but the record. Raises InputError."""

    def content(self, name: str) -> bytes:
        """All bytes of a file. Raises InputError."""

    def readable(self, name: str) -> Path | BinaryIO:
        """What a library can read a file from: its path, or its bytes where it has none. Raises InputError."""

    def opened(self, name: str) -> AbstractContextManager[Path]:
        """The path of a file, for the time of a block. Raises InputError."""

    def record(self) -> Record | None:
        """The record of all files; None where it is not valid."""


@dataclass(frozen=True)
class FolderFiles:
    """Files in a folder of their own."""

    folder: Path

    def place(self, name: str) -> str:
        """Its path."""
        return str(self.folder / name)

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return (self.folder / name).exists()

    def sizes(self) -> dict[str, int]:
        """Bytes of each file but the record."""
        names = (name for name in durable.names_of(self.folder) if name != RECORD)
        return {name: (self.folder / name).stat().st_size for name in names}

    def content(self, name: str) -> bytes:
        """All bytes of a file. Raises InputError."""
        with _sentences(self.folder / name):
            return durable.read_plain(self.folder / name)

    def readable(self, name: str) -> Path:
        """The path of a file."""
        return self.folder / name

    @contextmanager
    def opened(self, name: str) -> Iterator[Path]:
        """The path of a file."""
        yield self.folder / name

    def record(self) -> Record | None:
        """The record of all files; None where it is not valid, or of another folder."""
        record = record_in_folder(os.fspath(self.folder))
        if record is not None and self.folder.as_posix().endswith(f"/{record.name}"):
            return record
        return None


def record_in_folder(folder: str) -> Record | None:
    """The record in a folder if it is valid, and the files are there with their sizes."""
    try:
        record = record_of(durable.read_small(f"{folder}/{RECORD}", MOST_BYTES))
        if record is None or not stat.S_ISDIR(os.lstat(folder).st_mode):
            return None
        for name, (size, _) in record.files.items():
            there = os.lstat(f"{folder}/{name}")
            if there.st_size != size or not stat.S_ISREG(there.st_mode):
                return None
    except OSError:
        return None
    return record


@dataclass(frozen=True)
class ShardFiles:
    """Files of one sample in a shard.

    path : of the shard, or its object in a store.  offset : where the sample starts; None where there are no files.
    key : of the sample; None for any.  size : its bytes, where they are known: an object is asked for all at once.
    """

    path: Place
    offset: int | None
    key: str | None
    size: int | None = None

    def place(self, name: str) -> str:
        """The shard, and where the sample starts in it."""
        if self.offset is None:
            return f"{self.path}: {name}"
        return f"{self.path} (sample at byte {self.offset}): {name}"

    @property
    def folder(self) -> Path:
        """Raises InputError."""
        raise InputError(
            f"this sample is in the shard {self.path} and has no folder; files.content(name) are the bytes of a file."
        )

    def _opened(self) -> BinaryIO:
        if self._range is None:
            return opened(self.path)
        return ByteRange(self._range, self.offset or 0)

    @cached_property
    def _range(self) -> bytes | None:
        """The bytes of the sample, of an object."""
        if isinstance(self.path, Path) or self.offset is None or self.size is None:
            return None
        return self.path.read(self.offset, self.offset + self.size)

    @cached_property
    def _group(self) -> Group:
        if self.offset is None:
            return Group(0, {})
        with _sentences(self.path), self._opened() as file:
            group = group_at(file, self.offset)
        if group is None:
            raise InputError(f"{self.place(RECORD)} is not as it was written; {MADE_AGAIN}.")
        return group

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return name in self._group.files

    def sizes(self) -> dict[str, int]:
        """Bytes of each file but the record. Raises InputError."""
        members = sorted(self._group.files.items())
        return {name: member.size for name, member in members if name != RECORD}

    def content(self, name: str) -> bytes:
        """All bytes of a file. Raises InputError."""
        member = self._group.files.get(name)
        if member is None:
            raise InputError(f"there is no {self.place(name)}; {CHANGED}.")
        with _sentences(self.path), self._opened() as file:
            return content_of(file, member)

    def readable(self, name: str) -> BinaryIO:
        """The bytes of a file. Raises InputError."""
        return io.BytesIO(self.content(name))

    @contextmanager
    def opened(self, name: str) -> Iterator[Path]:
        """The path of a copy of a file."""
        with tempfile.TemporaryDirectory(prefix="mitsuba-sensor-") as folder:
            path = Path(folder) / name
            durable.write_copy(path, self.content(name))
            yield path

    def record(self) -> Record | None:
        """The record of all files; None where it is not valid, or of another sample."""
        with suppress(InputError):
            record = record_of(self.content(RECORD))
            if record is not None and self.key in (None, record.key):
                return record
        return None


def require_file(files: EntryFiles, name: str, output: str) -> None:
    """Raise InputError where a file that ``output`` needs is not there."""
    if not files.has(name):
        raise InputError(
            f"there is no {files.place(name)}; name what {output} needs in the outputs of the dataset, and make it "
            "again."
        )


def checked(files: EntryFiles, name: str) -> bytes:
    """The bytes of a file, if they are still those of the record beside it. Raises InputError."""
    with suppress(InputError):
        record, content = files.record(), files.content(name)
        written: Mapping[str, tuple[int, str]] = {}
        if record is not None:
            written = record.files
        if (len(content), hashlib.sha256(content).hexdigest()) == written.get(name):
            return content
    raise InputError(f"{files.place(name)} is not as it was written; {MADE_AGAIN}.")


@contextmanager
def _sentences(path: Place) -> Iterator[None]:
    """Turn what cannot be read into one sentence."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}; {CHANGED}.") from None
