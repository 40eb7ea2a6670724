"""Records of a dataset's entries: which files an entry has, their sizes and hashes, and a hash over all that.

Records and notes of quarantine end with the SHA-256 of their own bytes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias, get_args

from ...files.durable import SCRATCH
from .names import is_name_of_entry

Kind: TypeAlias = Literal["samples", "views", "lights"]
KINDS: tuple[Kind, ...] = get_args(Kind)
FILE, INDEX, SHARDS, RECORD = "dataset.toml", "index", "shards", "record.json"
"""What a folder of a dataset has beside its entries; INDEX and SHARDS are folders, and each entry has a record too."""
FOR_PEOPLE = TABLE, CARD, SHEET = "samples.csv", "README.md", "contact_sheet.png"
"""For people: made from the index whenever it changes, part of nothing that is verified."""
QUARANTINE = "quarantine"
OF_FOLDER = {FILE, RECORD, INDEX, SHARDS, QUARANTINE, *KINDS, *FOR_PEOPLE}
"""All that a run puts into the folder of a dataset."""
UNFINISHED = (SCRATCH, *(f".{name}." for name in (FILE, RECORD, *FOR_PEOPLE)))
"""Beginnings of the names of scratch folders, and of pages until they are whole (files/appearing.py)."""
MOST_BYTES = 2**20
"""Of the record of an entry; one of 8 files has 0.9 kB."""
MOST_BYTES_OF_DATASET = 2**27
"""Of the record of a dataset, which has 150 bytes for each file that it is made from."""

KEY = re.compile("[0-9a-f]{24}")
_HASH = re.compile("[0-9a-f]{64}")
_END = ', "sha256": "{}"}}\n'
_END_BYTES = len(_END.format("0" * 64))


class Entry(NamedTuple):
    """A sample, the files of a view, or the light of one that several tasks need.  name : of its folder.  key : hash of
    its configuration, by which it is told from others of that name, which earlier texts of a dataset file had."""

    kind: Kind
    name: str
    key: str


class Record(NamedTuple):
    """One entry that is there.  name : of the folder in which it is.  files : name → (bytes, SHA-256), without
    record.json itself."""

    kind: Kind
    name: str
    key: str
    files: Mapping[str, tuple[int, str]]


def sealed(text: str) -> bytes:
    """A text that ends with an object of JSON, with the SHA-256 of all bytes before as the object's last member."""
    body = text.removesuffix("}").encode()
    return body + _END.format(hashlib.sha256(body).hexdigest()).encode()


def unsealed(content: bytes) -> str | None:
    """The text that :func:`sealed` was given; None if one bit of it is different."""
    body = content[:-_END_BYTES]
    if content[-_END_BYTES:] != _END.format(hashlib.sha256(body).hexdigest()).encode():
        return None
    try:
        return body.decode() + "}"
    except UnicodeDecodeError:
        return None


def text_of(record: Record) -> bytes:
    """What record.json holds: one line of JSON, at its end the SHA-256 of all bytes before."""
    files = {name: list(facts) for name, facts in sorted(record.files.items())}
    return sealed(json.dumps({**record._asdict(), "files": files}))


def record_of(content: bytes) -> Record | None:
    """The record that :func:`text_of` wrote; None if one bit of it is different, or a name in it is no file's."""
    body = unsealed(content)
    if body is None:
        return None
    try:
        said = json.loads(body)
        files = {name: (size, digest) for name, (size, digest) in said["files"].items()}
        record = Record(said["kind"], said["name"], said["key"], files)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    if _possible(record):
        return record
    return None


def _possible(record: Record) -> bool:
    """Whether kind, key, names, sizes and hashes are such, whoever wrote them."""
    known = (
        record.kind in KINDS
        and is_name_of_entry(record.name)
        and isinstance(record.key, str)
        and KEY.fullmatch(record.key) is not None
    )
    return known and all(
        is_name(name)
        and type(size) is int
        and size >= 0
        and isinstance(digest, str)
        and _HASH.fullmatch(digest)
        for name, (size, digest) in record.files.items()
    )


def is_name(name: str) -> bool:
    """Whether a file of an entry may be called so: it lies in the entry's own folder, not hidden, not the record."""
    return (
        not name.startswith(".") and not set(name) & set("/\\\0") and name not in ("", RECORD)
    )
