"""Samples in a tar file: members NUMBER.frame.tiff, NUMBER.sample.json, …, at the end NUMBER/record,json.

The files that all samples of a view share are with one of them: NUMBER/aovs,exr, …
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from ...files import durable
from ...files.tar_members import Member, content_of, found_members, members
from .record import MOST_BYTES, RECORD, Record, record_of

_MEMBER = re.compile(r"(\d{10})([./])(.+)")


def member_name(number: int, name: str, passed_over: bool = False) -> str:
    """What a file of a sample is called in a shard.

    passed_over : by readers of WebDataset, because its name has no dot: for them all samples have the same files.
    """
    if passed_over:
        return f"{number:010d}/{name.replace('.', ',')}"
    return f"{number:010d}.{name}"


class Group(NamedTuple):
    """The members of one sample, by the names that its files have."""

    number: int
    files: dict[str, Member]

    @property
    def start(self) -> int:
        """Where its first member starts."""
        return min(member.start for member in self.files.values())

    @property
    def end(self) -> int:
        """Where the next sample starts."""
        return max(member.end for member in self.files.values())


def groups_in(found: Iterable[Member]) -> Iterator[Group]:
    """Samples whose members stand one after another."""
    group: Group | None = None
    for member in found:
        if (name := _MEMBER.fullmatch(member.name)) is None:
            continue
        number = int(name[1])
        if group is None or group.number != number:
            if group is not None:
                yield group
            group = Group(number, {})
        file_name = name[3]
        if name[2] == "/":
            file_name = file_name.replace(",", ".")
        group.files[file_name] = member
    if group is not None:
        yield group


def group_at(file: BinaryIO, offset: int) -> Group | None:
    """The sample that begins there."""
    return next(groups_in(members(file, offset)), None)


def record_in(file: BinaryIO, group: Group) -> Record | None:
    """The record of a sample; None where it has none that is valid."""
    member = group.files.get(RECORD)
    if member is None or member.size > MOST_BYTES:
        return None
    return record_of(content_of(file, member))


def sound_members(
    file: BinaryIO, group: Group, key: str | None = None
) -> dict[str, bytes] | None:
    """The contents of all members of a sample by their names; None where they are not as they were written.

    key : of the sample, if it is known.
    """
    record = record_in(file, group)
    if record is None or {*record.files, RECORD} != {*group.files}:
        return None
    if key is not None and record.key != key:
        return None
    contents = {name: content_of(file, member) for name, member in group.files.items()}
    for name, (size, digest) in record.files.items():
        content = contents[name]
        if (len(content), hashlib.sha256(content).hexdigest()) != (size, digest):
            return None
    return {group.files[name].name: content for name, content in contents.items()}


def damaged_samples(path: Path) -> list[str]:
    """Numbers of the samples in a shard that are not as they were written, as its members are called."""
    with durable.open_to_read(path) as file:
        groups = groups_in(found_members(path))
        return [f"{group.number:010d}" for group in groups if not sound_members(file, group)]
