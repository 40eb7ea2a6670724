"""Pieces of a shard: samples with consecutive numbers in a file of their own, which appears whole."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO, NamedTuple, Self

from ...files import durable
from ...files.disk_errors import disk_sentences
from ...files.tar_members import END, member_bytes
from ...stopping import undone_if_stopped, whole_step

TRIES = 10
"""At making the folder of the pieces, which other programs remove when it is empty."""
_PIECE = re.compile(r"(\d+)-(\d{1,5})-([0-9a-f]{64})\.tar")


class Piece(NamedTuple):
    """Samples with consecutive numbers from ``first`` on, in a file of their own."""

    first: int
    rows: int
    digest: str

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.first}-{self.rows}-{self.digest}.tar"

    @property
    def numbers(self) -> range:
        """Of its samples."""
        return range(self.first, self.first + self.rows)


def pieces_in(place: Path) -> list[Piece]:
    """The pieces in a folder, in the order of their numbers, long ones first."""
    found = []
    for name in durable.names_of(place):
        if match := _PIECE.fullmatch(name):
            found.append(Piece(int(match[1]), int(match[2]), match[3]))
    return sorted(found, key=lambda piece: (piece.first, -piece.rows))


class PieceWriter:
    """Writes samples into a piece, which appears when the block ends, however it ends: what is in it is whole.

    place : folder of the pieces of a block.  Raises DiskFull and InputError.
    """

    def __init__(self, place: Path) -> None:
        self.place = place
        self._stack = ExitStack()
        self._file: IO[bytes] | None = None
        self._scratch = place
        self._first = self._rows = self._bytes = 0
        self._hash = hashlib.sha256()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def rows(self) -> int:
        """Samples in the piece that is being written."""
        return self._rows

    @property
    def size(self) -> int:
        """Bytes of the piece that is being written."""
        return self._bytes

    def add(self, number: int, members: Mapping[str, bytes]) -> None:
        """Append a sample.  members : content of each by its name, the record last."""
        if self._file is not None and number != self._first + self._rows:
            self.close()
        content = b"".join(member_bytes(name, file) for name, file in members.items())
        with disk_sentences(self.place, self._bytes + len(content)):
            if self._file is None:
                self._begin(number)
            assert self._file is not None
            try:
                write_all(self._file, content)
            except OSError:
                with suppress(OSError):
                    self._file.truncate(self._bytes)
                    self._file.seek(self._bytes)
                raise
        self._hash.update(content)
        self._rows, self._bytes = self._rows + 1, self._bytes + len(content)

    def _begin(self, number: int) -> None:
        for _ in range(TRIES):
            durable.make_place(self.place)
            self._scratch = durable.scratch_name(self.place)
            with (
                suppress(FileNotFoundError),
                whole_step,
            ):  # another program removes the folder, empty
                self._file = self._stack.enter_context(durable.begin_file(self._scratch))
                self._stack.enter_context(undone_if_stopped(self._remove))
                break
        self._first = number

    def _remove(self) -> None:
        durable.remove_file(self._scratch)

    def close(self) -> None:
        """Let the piece appear. It is not flushed: who joins pieces looks at each again."""
        if self._file is None:
            return
        try:
            with disk_sentences(self.place, self._bytes):
                if self._rows:
                    write_all(self._file, END)
                    self._hash.update(END)
                    self._file.close()
                    self._appear(Piece(self._first, self._rows, self._hash.hexdigest()))
        finally:
            self._stack.close()
            with suppress(OSError):
                self._remove()
            self._file, self._hash = None, hashlib.sha256()
            self._first = self._rows = self._bytes = 0

    def _appear(self, piece: Piece) -> None:
        with whole_step:
            try:
                os.rename(self._scratch, self.place / piece.name)
            except FileNotFoundError:  # the block became whole meanwhile, by another program
                if self._scratch.exists():
                    raise


def write_all(file: IO[bytes], content: bytes) -> None:
    """Write all of it into a file that has no buffer."""
    left = memoryview(content)
    while left:
        left = left[file.write(left) :]
