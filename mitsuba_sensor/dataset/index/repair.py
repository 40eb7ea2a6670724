"""Finds what is not as it was written, and makes exactly that again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

from ...core import InputError
from ...files import durable
from ...files.appearing import refuse_empty
from ...files.objects import Place
from ..plan.planned import DatasetPlan
from ..store.faults import Fault
from ..store.record import FILE, INDEX, KINDS, RECORD, Entry, Kind, Record
from ..store.shard_size import NUMBERS
from ..store.shards import Shards, shard_called
from ..store.store import Store
from .origin import Origin, origin_faults, origin_in, origin_of
from .part import Line, OpenPart, Part, all_parts, parts_of
from .writer import lines_of

Show = Callable[[int, int], object]
Named: TypeAlias = tuple[Kind | Literal["shards"], str]
"""Kind and name of an entry or shard."""
Held: TypeAlias = tuple[Kind | Literal["shards"], str, str]
"""The same and the key of the entry; a shard has none."""


def verify(
    folder: Path, show: Show | None = None, roots: Sequence[str | Path] | None = None
) -> Iterator[Fault]:
    """Every difference between a dataset folder and what was written: all files are read.

    show : called with the number of entries that are done, and of all.  roots : folders with the files that it was
    made from; by default the current one, as of a run.  Raises InputError where there is no dataset.
    """
    store, unrecorded = store_of(folder), dict[tuple[Kind, str], Fault]()
    for fault in store.verify_all(show):
        if fault.kind in KINDS and (fault.file, fault.what) == (RECORD, "missing"):
            unrecorded[fault.kind, fault.name] = fault
        else:
            yield fault
    yield from origin_faults(folder, [Path(root) for root in roots or ["."]])
    if origin := origin_in(folder):
        yield from _index_faults(store, origin, unrecorded)
    yield from unrecorded.values()


def _index_faults(
    store: Store, origin: Origin, unrecorded: dict[tuple[Kind, str], Fault]
) -> Iterator[Fault]:
    """What is not as it was written in the index, and what it names and is not there.

    unrecorded : what stands in the places of entries without a record, of which those that no whole index names become
    strays.
    """
    parts = parts_of(origin.digest, all_parts(store.folder))
    for number in range(origin.parts):
        if number not in parts:
            yield Fault("dataset", "", f"{INDEX}/{number:06d}", "missing")
    own, changed = {part.name for part in parts.values()}, list[Part]()
    for name in durable.names_of(store.folder / INDEX):
        if name not in own and not name.startswith("."):
            yield Fault("dataset", "", f"{INDEX}/{name}", "stray")
    shards = {shard.name for shard in store.shards.all()}
    for kind, name, key in entries_of(sound_lines(store.folder, parts.values(), changed)):
        if kind == "shards":
            there = name in shards
        else:
            if fault := unrecorded.pop((kind, name), None):
                yield fault
            record = store.record(kind, name)
            is_another = record is not None and record.key != key
            there = not is_another and store.folder_of(kind, name).exists()
        if not there:
            yield Fault(kind, name, "", "missing")
    for part in changed:
        yield Fault("dataset", "", f"{INDEX}/{part.name}", "changed")
    if len(parts) == origin.parts and not changed:
        for kind, name in unrecorded:
            yield Fault(kind, "", name, "stray")
        unrecorded.clear()


def sound_lines(folder: Place, parts: Iterable[Part], changed: list[Part]) -> Iterator[Line]:
    """The lines of all parts that are as they were written; the others are added to ``changed``."""
    for part in parts:
        try:
            lines = [*OpenPart(folder, part).lines()]
        except InputError:
            changed.append(part)
        else:
            yield from lines


def entries_of(lines: Iterable[Line]) -> Iterator[Held]:
    """Samples, and views that have files, or shards; a view or shard once, as its samples follow one another."""
    view = shard = ""
    for line in lines:
        if line.place is None:
            yield "samples", line.name, line.key
            if line.view_files and line.view != view:
                yield "views", line.view_name, line.view
            view = line.view
        elif line.place.shard != shard:
            shard = line.place.shard
            yield "shards", shard, ""


def discard(folder: Path, faults: Sequence[Fault]) -> list[Named]:
    """Remove the entries that have a fault; kinds and names of all that have one. Files that belong to no entry stay,
    and so does a folder without a record, or with that of another entry: it may be anybody's, and a run replaces it
    where it needs its place.

    Parts of the index that have one, or name such an entry, are removed before: a run looks for what they name. Notes
    of quarantine that have one are removed too, so that their views are tried again. Of a shard a run keeps the samples
    that are as they were written.
    """
    store, broken, own = store_of(folder), set[Named](), set[Named]()
    for fault in faults:
        if fault.kind == "quarantine" and fault.name:
            store.release(fault.name)
        elif fault.name and fault.kind in ("samples", "views", "lights", "shards"):
            broken.add((fault.kind, fault.name))
            if fault.file != RECORD or fault.what not in ("missing", "of another entry"):
                own.add((fault.kind, fault.name))
    for part in all_parts(folder):
        if not _is_sound(folder, part, broken):
            durable.remove_folder(folder / INDEX / part.name)
            durable.sync_folder(folder / INDEX)
    for kind, name in sorted(own):
        if kind != "shards":
            store.discard(kind, name)
        elif shard := shard_called(name):
            store.shards.spoil(shard)
    return sorted(broken)


def _is_sound(folder: Path, part: Part, broken: Set[Named]) -> bool:
    """Whether a part of the index is as it was written, and names no broken entry."""
    try:
        entries = entries_of(OpenPart(folder, part).lines())
        return broken.isdisjoint((kind, name) for kind, name, _ in entries)
    except InputError:
        return False


class Holdings(NamedTuple):
    """What a folder has.  samples : of the dataset, of which are there : so many, with so many bytes, those of the
    files that views share included.  others : samples that an earlier text of the dataset file had, their views'
    files included."""

    samples: int
    there: int
    bytes: int
    others: int
    others_bytes: int


def holdings(store: Store, plan: DatasetPlan) -> Holdings:
    """By the index, and by the records of the store or the names of shards: no file of a sample is read."""
    if plan.shard_samples:
        return _holdings_in_shards(store.shards, plan)
    there = size = 0
    for kind, name, key in entries_of(_planned_lines(store.folder, plan)):
        if kind != "shards" and (record := store.find(Entry(kind, name, key))):
            there += kind == "samples"
            size += _bytes_of(record)
    others, others_bytes = -there, -size
    for record in chain(store.scan("samples"), store.scan("views")):
        others += record.kind == "samples"
        others_bytes += _bytes_of(record)
    return Holdings(plan.samples, there, size, others, others_bytes)


def _holdings_in_shards(shards: Shards, plan: DatasetPlan) -> Holdings:
    """The same of a dataset in shards; those that no plan needs any more are the others."""
    own, there, in_pieces = set[str](), 0, 0
    parts, size = (
        parts_of(origin_of(plan).digest, all_parts(shards.dataset)),
        plan.shard_samples,
    )
    for number in range(-(-plan.numbers // NUMBERS)):
        part = parts.get(number)
        if part is not None and part.is_whole:
            own |= {name for _, name, _ in entries_of(OpenPart(shards.dataset, part).lines())}
            there += part.rows
            continue
        end = min((number + 1) * NUMBERS, plan.numbers)
        for block_number in range(number * NUMBERS // size, -(-end // size)):
            block, _ = plan.block(block_number)
            own |= {shard.name for shard in shards.of(block)}
            there += min(len(shards.numbers(block)), block.planned)
            in_pieces += shards.bytes_of_pieces(block)
    found, held = shards.all(), Counter[bool]()
    for shard in found:
        held[shard.name in own] += (shards.folder / shard.name).stat().st_size
    others = sum(shard.rows for shard in found if shard.name not in own)
    return Holdings(plan.samples, there, held[True] + in_pieces, others, held[False])


def _planned_lines(folder: Path, plan: DatasetPlan) -> Iterator[Line]:
    """The lines of a complete index: those that are there, and those that are planned for the rest."""
    parts = parts_of(origin_of(plan).digest, all_parts(folder))
    for number in range(-(-plan.numbers // NUMBERS)):
        part = parts.get(number)
        if part is not None and part.is_whole:
            yield from OpenPart(folder, part).lines()
        else:
            for view in plan.views(number * NUMBERS, (number + 1) * NUMBERS):
                yield from lines_of(view)


def _bytes_of(record: Record) -> int:
    return sum(size for size, _ in record.files.values())


def store_of(folder: Path) -> Store:
    """The store in a dataset folder. Raises InputError where it is none."""
    refuse_empty(folder, "the folder", "give the folder of a dataset")
    if not any((folder / name).exists() for name in (FILE, INDEX)):
        raise InputError(
            f"{folder} is no dataset: it has no {FILE}; give a folder that `dataset run` made."
        )
    return Store(folder)
