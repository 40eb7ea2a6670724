"""Shards: tar files of many samples, in the layout of WebDataset, each of which appears whole.

A block of samples with consecutive numbers is one shard, shards/BLOCK-…-SHA256.tar, when all of it is there. Until then
whoever makes some of them leaves pieces of it, shards/BLOCK/FIRST-COUNT-SHA256.tar, which one program joins at the end.
A sample has members NUMBER.frame.tiff, NUMBER.sample.json, …, at the end NUMBER/record,json with their hashes. The same
samples are the same bytes, whoever made them in which pieces.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from ...core import InputError
from ...files import durable
from ...files.disk_errors import disk_sentences
from ...files.tar_members import END, found_members, members
from ...stopping import undone_if_stopped, whole_step
from .pieces import Piece, PieceWriter, pieces_in, write_all
from .record import SHARDS
from .shard_members import Group, groups_in, sound_members

TRIES = 10
"""At joining pieces that another program joins, too."""
AT_ONCE = 2**20
"""Bytes that are copied at once."""
_SHARD = re.compile(r"(\d{6,8}-[0-9a-f]{12})-(\d{1,5})-of-(\d{1,5})-([0-9a-f]{64})\.tar")
_STEM = re.compile(r"\d{6,8}-[0-9a-f]{12}")


class Block(NamedTuple):
    """Samples that are one shard.

    number : from 0.  keys : first 12 digits of the SHA-256 of their numbers and keys.  planned : how many they are.
    """

    number: int
    keys: str
    planned: int

    @property
    def stem(self) -> str:
        """Beginning of the name of its shard, and the name of the folder of its pieces."""
        return f"{self.number:06d}-{self.keys}"


class Shard(NamedTuple):
    """A shard by its name.  stem : of its block.  rows : samples in it, of so many ``planned``.  digest : SHA-256."""

    stem: str
    rows: int
    planned: int
    digest: str

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.stem}-{self.rows}-of-{self.planned}-{self.digest}.tar"

    @property
    def is_whole(self) -> bool:
        """Whether it has all samples of its block."""
        return self.rows == self.planned


def shard_called(name: str) -> Shard | None:
    """The shard whose file has this name; None of any other file."""
    if (found := _SHARD.fullmatch(name)) is None:
        return None
    stem, rows, planned, digest = found.groups()
    shard = Shard(stem, int(rows), int(planned), digest)
    return shard if shard.name == name else None


def is_stem(name: str) -> bool:
    """Whether a folder of pieces may be called so."""
    return _STEM.fullmatch(name) is not None


class Shards:
    """The shards in the folder of a dataset, and the pieces of those that are not whole."""

    def __init__(self, dataset: Path) -> None:
        self.dataset, self.folder = dataset, dataset / SHARDS
        self._looked_at: tuple[Block, set[int] | range] | None = None

    def all(self) -> list[Shard]:
        """All shards, of whatever plan, in the order of their names."""
        return self._beginning("")

    def of(self, block: Block) -> list[Shard]:
        """The shards of a block, those with more samples first."""
        return sorted(self._beginning(block.stem), key=lambda shard: -shard.rows)

    def _beginning(self, text: str) -> list[Shard]:
        names = (name for name in durable.names_of(self.folder) if name.startswith(text))
        return [shard for shard in map(shard_called, names) if shard is not None]

    def pieces(self, block: Block) -> list[Piece]:
        """The pieces of a block."""
        return pieces_in(self.folder / block.stem)

    def bytes_of_pieces(self, block: Block) -> int:
        """How large the pieces of a block are."""
        place = self.folder / block.stem
        return sum((place / piece.name).stat().st_size for piece in self.pieces(block))

    def piece_numbers(self, block: Block) -> set[int]:
        """Numbers of the samples that are in pieces."""
        return {number for piece in self.pieces(block) for number in piece.numbers}

    def numbers(self, block: Block) -> set[int] | range:
        """Numbers of the samples of a block that are there; of a whole shard all that there are.

        Those of the block that was asked for last are known until :meth:`forget`.
        """
        if self._looked_at is None or self._looked_at[0] != block:
            self._looked_at = block, self._numbers(block)
        return self._looked_at[1]

    def _numbers(self, block: Block) -> set[int] | range:
        found = self.piece_numbers(block)
        for shard in self.of(block):
            if shard.is_whole:
                return range(2**63 - 1)
            found |= {group.number for group in self.groups(shard)}
        return found

    def forget(self) -> None:
        """Look again from now on."""
        self._looked_at = None

    def groups(self, shard: Shard) -> list[Group]:
        """Where the samples of a shard are. Raises InputError."""
        path = self.folder / shard.name
        with disk_sentences(path), durable.open_to_read(path) as file:
            return [*groups_in(members(file))]

    def writer(self, block: Block) -> PieceWriter:
        """Writes samples of a block."""
        return PieceWriter(self.folder / block.stem)

    def join(self, block: Block) -> Shard | None:
        """Make one shard of all that is there of a block; None where nothing is. Raises DiskFull and InputError.

        When this returns, a power cut loses nothing of it.
        """
        for _ in range(TRIES):
            before = self.of(block), self.pieces(block)
            try:
                return self._join(block)
            except (FileNotFoundError, InputError):
                if before == (self.of(block), self.pieces(block)):
                    raise  # no other program joins them, too
        raise InputError(
            f"cannot write {self.folder / block.stem}: its files are removed again and again; find out by what."
        )

    def _join(self, block: Block) -> Shard | None:
        older, place = self.of(block), self.folder / block.stem
        if older and older[0].is_whole:
            self._remove([self.folder / shard.name for shard in older[1:]])
            durable.remove_folder(place)
            return older[0]
        self._remove(self._unsound(block))
        pieces = self.pieces(block)
        if not pieces and len(older) < 2:
            return older[0] if older else None
        sources = [self.folder / shard.name for shard in older]
        if len(pieces) == 1 and not older:
            shard = self._from_piece(block, pieces[0])
        else:
            sources += [place / piece.name for piece in pieces]
            shard = self._joined(block, sources)
        self._remove([path for path in sources if path.name != shard.name])
        if shard.is_whole:
            durable.remove_folder(place)
        else:
            with suppress(OSError):  # another program makes the rest
                place.rmdir()
        return shard

    def _from_piece(self, block: Block, piece: Piece) -> Shard:
        """A piece that is alone is the shard."""
        path = self.folder / block.stem / piece.name
        shard = Shard(block.stem, piece.rows, block.planned, piece.digest)
        durable.flush(path, path.stat().st_size, piece.digest)
        self._publish(path, shard)
        return shard

    def _joined(self, block: Block, sources: list[Path]) -> Shard:
        """All samples of some files in one, in the order of their numbers, each once."""
        scratch, slices = durable.scratch_name(self.folder), _slices(sources)
        size, digest = sum(end - start for _, start, end in slices) + len(END), hashlib.sha256()

        def remove() -> None:
            durable.remove_file(scratch)

        with undone_if_stopped(remove):
            try:
                with durable.begin_file(scratch) as file:
                    for content in _contents(slices):
                        digest.update(content)
                        with disk_sentences(self.folder / block.stem, size):
                            write_all(file, content)
                shard = Shard(block.stem, len(slices), block.planned, digest.hexdigest())
                durable.flush(scratch, size, shard.digest)
                self._publish(scratch, shard)
            finally:
                with suppress(OSError):
                    remove()
        return shard

    def _publish(self, path: Path, shard: Shard) -> None:
        final = self.folder / shard.name
        with disk_sentences(final, durable.FOLDER_BYTES):
            with whole_step:
                os.replace(path, final)
            durable.make_folder(self.folder, self.dataset.parent)
            durable.sync_folder(self.folder)

    def _remove(self, paths: Iterable[Path]) -> None:
        for path in paths:
            with suppress(OSError):
                durable.remove_folder(path)

    def rescue(self, block: Block, keys: Mapping[int, str]) -> None:
        """Of pieces that are not as they were written keep the samples that are.  keys : of the samples, by number."""
        for shard in self.of(block):
            if not shard.is_whole and not _is_sound(self.folder / shard.name, shard.digest):
                self.spoil(shard)
        place = self.folder / block.stem
        for path in self._unsound(block):
            with (
                suppress(OSError),
                durable.open_to_read(path) as file,
                self.writer(block) as writer,
            ):
                for group in groups_in(found_members(path)):
                    contents = sound_members(file, group, keys.get(group.number, ""))
                    if contents is not None:
                        writer.add(group.number, contents)
            durable.remove_folder(path)
        with suppress(OSError):
            place.rmdir()

    def _unsound(self, block: Block) -> list[Path]:
        """Pieces that are not as they were written."""
        place = self.folder / block.stem
        pieces = ((place / piece.name, piece.digest) for piece in self.pieces(block))
        return [path for path, digest in pieces if not _is_sound(path, digest)]

    def spoil(self, shard: Shard) -> None:
        """Make a shard that is not as it was written a piece that is none: a run keeps what is sound of it."""
        path, place = self.folder / shard.name, self.folder / shard.stem
        with disk_sentences(path), suppress(FileNotFoundError):
            if path.is_symlink() or not path.is_file():
                durable.remove_folder(path)
                return
            durable.make_place(place)
            os.replace(path, place / Piece(0, 0, shard.digest).name)
            durable.sync_folder(self.folder)


def _is_sound(path: Path, digest: str) -> bool:
    """Whether a plain file has this SHA-256."""
    with suppress(FileNotFoundError):  # another program removes it
        return path.is_file() and not path.is_symlink() and durable.sha256_of(path) == digest
    return False


def _slices(sources: Iterable[Path]) -> list[tuple[Path, int, int]]:
    """Where each sample is, by number: file, start and end. Of one that is there twice the first is taken."""
    found = dict[int, tuple[Path, int, int]]()
    for path in sources:
        with durable.open_to_read(path) as file:
            for group in groups_in(members(file)):
                found.setdefault(group.number, (path, group.start, group.end))
    return [found[number] for number in sorted(found)]


def _contents(slices: Iterable[tuple[Path, int, int]]) -> Iterator[bytes]:
    """The bytes of a tar file of these slices."""
    for path, of_file in groupby(slices, key=itemgetter(0)):
        with durable.open_to_read(path) as file:
            for _, start, end in of_file:
                file.seek(start)
                while start < end:
                    content = file.read(min(AT_ONCE, end - start))
                    start += len(content)
                    yield content
    yield END
