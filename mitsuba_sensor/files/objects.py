"""Objects in a store that fsspec reaches, for example S3: listed, read by ranges of bytes, and put whole.

The only module that imports fsspec. An object appears when its upload ends, with all its bytes: nothing is renamed.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeAlias

from ..core import InputError
from . import durable

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+://.+")
READ_AHEAD = 2**20
"""Bytes that are asked for at once where it is not known how many are read."""
PACKAGES = "`pip install 'mitsuba-sensor[s3]'` is for S3, other stores need the package that is named here."
LOCAL = "file", "local"
"""Protocols of files of this machine, which fsspec writes in their place, byte by byte."""


def is_address(place: object) -> bool:
    """Whether a text is an address like s3://bucket/pairs, and no path."""
    return isinstance(place, str) and _ADDRESS.fullmatch(place) is not None


class ByteRange(io.BytesIO):
    """Some bytes of a file, which are found at their places in it."""

    def __init__(self, content: bytes, start: int) -> None:
        super().__init__(content)
        self._start = start

    def seek(self, place: int, whence: int = os.SEEK_SET, /) -> int:
        """Go to a place of the whole file."""
        if whence != os.SEEK_SET or place < self._start:
            raise ValueError(f"{place} is before the first byte that is here, {self._start}.")
        return super().seek(place - self._start) + self._start


@dataclass(frozen=True)
class Objects:
    """An object, or all objects whose names begin with this one and a slash.

    address : s3://bucket/name, memory://name, file:///folder/name, or of another protocol that fsspec knows.
    """

    address: str

    def __truediv__(self, name: str) -> Objects:
        return Objects(f"{self.address.rstrip('/')}/{name}")

    def __str__(self) -> str:
        return self.address

    def sizes(self) -> dict[str, int]:
        """Name → bytes of all objects directly below. Raises InputError."""
        with self._reached("be listed") as (store, path):
            store.invalidate_cache()  # others put objects, too
            found = []
            with suppress(FileNotFoundError, NotADirectoryError):
                found = store.ls(path, detail=True)
            files = (one for one in found if one["type"] == "file")
            sizes = {one["name"].rpartition("/")[2]: int(one["size"]) for one in files}
        return dict(sorted(sizes.items()))

    def read(self, start: int = 0, end: int | None = None) -> bytes:
        """The bytes of an object from ``start`` to before ``end``; from −n the last n. Raises InputError."""
        with self._reached("be read") as (store, path):
            content: bytes = store.cat_file(path, start=start or None, end=end)
        return content

    def opened(self) -> BinaryIO:
        """An object as a file of which parts are read ahead. Raises InputError."""
        with self._reached("be read") as (store, path):
            file: BinaryIO = store.open(path, "rb", block_size=READ_AHEAD)
        return file

    def put(self, file: Path) -> None:
        """Upload a file, in place of what is there. Raises InputError."""
        with self._reached("be written") as (store, path):
            if store.protocol == LOCAL:
                _put_here(file, Path(path))
            else:
                store.put_file(str(file), path)

    @contextmanager
    def _reached(self, what: str) -> Iterator[tuple[AbstractFileSystem, str]]:
        """The store, and the object's name in it; whatever goes wrong becomes one sentence.

        The store is looked up each time, because a process that was forked has another one.
        """
        try:
            from fsspec.core import url_to_fs

            yield url_to_fs(self.address)
        except ImportError as error:
            raise InputError(
                f"{self.address} cannot {what}: {_told(error)}; {PACKAGES}"
            ) from error
        except Exception as error:  # each store has errors of its own
            raise InputError(
                f"{self.address} cannot {what}: {_told(error)}; check the address and how you are known there."
            ) from error


def _told(error: Exception) -> str:
    """What an error says, on one line."""
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__


def _put_here(file: Path, place: Path) -> None:
    """Copy a file to a place of this machine, at which it appears whole."""
    durable.make_folder(place.parent, place.parent.parent)
    scratch = durable.scratch_name(place.parent)
    try:
        with file.open("rb") as source, scratch.open("xb") as copy:
            while content := source.read(2**20):
                copy.write(content)
        durable.flush(scratch, *durable.size_and_hash(file))
        os.replace(scratch, place)
        durable.sync_folder(place.parent)
    finally:
        scratch.unlink(missing_ok=True)


Place: TypeAlias = Path | Objects
"""A folder or a file, or the same in a store of objects."""


def opened(place: Place) -> BinaryIO:
    """A file or an object, from which parts are read. Raises OSError for a file, and InputError for an object."""
    if isinstance(place, Objects):
        return place.opened()
    return durable.open_to_read(place)


def names_in(place: Place) -> list[str]:
    """Names in a folder, or of the objects directly below a place, sorted; none if nothing is there."""
    if isinstance(place, Objects):
        return [*place.sizes()]
    return durable.names_of(place)


def bytes_of(place: Place) -> bytes:
    """Content of a file or an object. Raises OSError for a file, and InputError for an object."""
    if isinstance(place, Objects):
        return place.read()
    return durable.read_plain(place)


def end_of(place: Place, most: int) -> bytes:
    """The last bytes of a file or an object, at most so many.

    Raises OSError for a file, and InputError for an object.
    """
    if isinstance(place, Objects):
        return place.read(-most)
    return durable.read_end(place, most)


def small_bytes_of(place: Place, most: int) -> bytes:
    """Content of a file or an object of at most ``most`` bytes; nothing of a longer one, a link or a pipe.

    Raises OSError for a file, and InputError for an object.
    """
    if isinstance(place, Path):
        return durable.read_small(os.fspath(place), most)
    content = place.read(0, most + 1)
    if len(content) <= most:
        return content
    return b""
