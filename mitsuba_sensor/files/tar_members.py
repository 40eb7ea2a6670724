"""Members of uncompressed tar files, found and read by their offsets; what is written has the same bytes always.

A file is a row of members, each a header of one block and its content, filled up to whole blocks; two empty blocks end
it. Members without that end are a piece: pieces one after another, and the end, are a file again.
"""

from __future__ import annotations

import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

BLOCK = 512
END = bytes(2 * BLOCK)
MAGIC = b"ustar"
_CHECKSUM = slice(148, 156)
_SPACES = 8 * ord(" ")
"""What the bytes of the checksum count for in it."""
LARGEST_MEMBER = 8**11 - 1
"""Bytes, which eleven octal digits say."""


class Member(NamedTuple):
    """A file in a tar file.  start : of its header.  offset, size : of its content."""

    name: str
    start: int
    offset: int
    size: int

    @property
    def end(self) -> int:
        """Where the next member starts."""
        return self.offset + -(-self.size // BLOCK) * BLOCK


def member_bytes(name: str, content: bytes) -> bytes:
    """A member: mode 0644, owner 0, time 0.  name : of at most 100 characters of ASCII."""
    entry = tarfile.TarInfo(name)
    entry.size = len(content)
    header = entry.tobuf(tarfile.USTAR_FORMAT, "ascii", "strict")
    return header + content + bytes(-len(content) % BLOCK)


def member_of(header: bytes, start: int) -> Member | None:
    """The member whose header stands at ``start``; None where there is none."""
    if header[257:262] != MAGIC or len(header) != BLOCK:
        return None
    try:
        checksum = int(header[_CHECKSUM].rstrip(b" \0"), 8)
        if checksum != sum(header) - sum(header[_CHECKSUM]) + _SPACES:
            return None
        name = header[:100].rstrip(b"\0").decode("ascii")
        return Member(name, start, start + BLOCK, int(header[124:135], 8))
    except ValueError:
        return None


def members(file: BinaryIO, start: int = 0, end: int | None = None) -> Iterator[Member]:
    """All members from ``start`` on, up to the first block that begins none, or to ``end``."""
    while end is None or start < end:
        file.seek(start)
        member = member_of(file.read(BLOCK), start)
        if member is None:
            return
        yield member
        start = member.end


def found_members(path: Path) -> Iterator[Member]:
    """All members that a damaged file still has: after what is none the search goes on at the next block."""
    size, start = path.stat().st_size, 0
    with path.open("rb", buffering=0) as file:
        while start < size:
            for member in members(file, start):
                yield member
                start = member.end
            start += BLOCK


def content_of(file: BinaryIO, member: Member) -> bytes:
    """The content of a member; shorter where the file ends in it."""
    file.seek(member.offset)
    return file.read(member.size)
