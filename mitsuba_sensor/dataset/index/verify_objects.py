"""Finds what is not as it was written of a dataset in an object store: every object that a reader may take is read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...core import InputError
from ...files.objects import Objects
from ..store.faults import Fault
from ..store.record import FILE, INDEX, RECORD, SHARDS
from ..store.shards import shard_called
from .origin import Origin, faults_of_sources, origin_in
from .part import part_called, parts_of
from .repair import Show, entries_of, sound_lines

AT_ONCE = 2**20
"""Bytes that are read at once."""


def verify_objects(
    place: Objects, show: Show | None = None, roots: Sequence[str | Path] | None = None
) -> Iterator[Fault]:
    """Every difference between a dataset in a store and what was pushed, by the hashes in its record and its names.

    show : called with the number of objects that are read, and of all.  roots : folders with the files that the samples
    were made from; by default the current one.  Raises InputError where there is no dataset, or the store does not
    answer.
    """
    shards, parts = ([*(place / kind).sizes()] for kind in (SHARDS, INDEX))
    if not (shards or parts):
        raise InputError(
            f"{place} is no dataset that was pushed; put one there with `mitsuba-sensor dataset push`."
        )
    for done, name in enumerate([*shards, *parts]):
        if show is not None:
            show(done, len(shards) + len(parts))
        if done < len(shards):
            yield from _shard_faults(place, name)
        else:
            yield from _part_faults(place, name)
    yield from _origin_faults(place, [Path(root) for root in roots or ["."]])
    if origin := origin_in(place):
        yield from _missing(place, origin, shards, parts)


def _shard_faults(place: Objects, name: str) -> Iterator[Fault]:
    shard = shard_called(name)
    if shard is None:
        yield Fault("shards", "", name, "stray")
    elif _written(place / SHARDS / name)[1] != shard.digest:
        yield Fault("shards", name, "", "changed")


def _part_faults(place: Objects, name: str) -> Iterator[Fault]:
    part = part_called(name)
    if part is None:
        yield Fault("dataset", "", f"{INDEX}/{name}", "stray")
    elif _written(place / INDEX / name)[1] != part.digest:
        yield Fault("dataset", "", f"{INDEX}/{name}", "changed")


def _origin_faults(place: Objects, roots: Sequence[Path]) -> Iterator[Fault]:
    """What is wrong with the record of the dataset and its file, and with the files that it was made from."""
    there, origin = place.sizes(), None
    if RECORD in there:
        origin = origin_in(place)
    if origin is None:
        yield Fault("dataset", "", RECORD, "changed" if RECORD in there else "missing")
        return
    if FILE not in there:
        yield Fault("dataset", "", FILE, "missing")
    elif _written(place / FILE) != origin.file:
        yield Fault("dataset", "", FILE, "changed")
    yield from faults_of_sources(origin, roots)


def _missing(
    place: Objects, origin: Origin, shards: Sequence[str], names: Sequence[str]
) -> Iterator[Fault]:
    """Parts of the index that are not there, and shards that are named by those that are as they were written.

    shards, names : of the objects that are there.
    """
    parts = parts_of(origin.digest, filter(None, map(part_called, names)))
    for number in range(origin.parts):
        if number not in parts:
            yield Fault("dataset", "", f"{INDEX}/{number:06d}", "missing")
    for kind, name, _ in entries_of(sound_lines(place, parts.values(), [])):
        if kind == "shards" and name not in shards:
            yield Fault("shards", name, "", "missing")


def _written(place: Objects) -> tuple[int, str]:
    """Bytes of an object, and their SHA-256."""
    size, digest = 0, hashlib.sha256()
    with place.opened() as file:
        while content := file.read(AT_ONCE):
            size += len(content)
            digest.update(content)
    return size, digest.hexdigest()
