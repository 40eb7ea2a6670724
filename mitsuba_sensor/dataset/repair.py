"""Finds what is not as it was written, and makes exactly that again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ..core import InputError
from ..files.appearing import refuse_empty
from .faults import Fault
from .origin import origin_faults, plan_lines
from .planned import DatasetPlan
from .reader import read_index
from .record import FILE, INDEX, Kind
from .store import Store

Show = Callable[[int, int], object]


def verify(folder: Path, show: Show | None = None) -> Iterator[Fault]:
    """Every difference between a dataset folder and what was written: all files are read.

    show : called with the number of entries that are done, and of all.  Raises InputError where there is no dataset.
    """
    store = store_of(folder)
    yield from store.verify_all(show)
    yield from origin_faults(folder)
    with suppress(InputError):
        yield from _missing_of_index(store)


def _missing_of_index(store: Store) -> Iterator[Fault]:
    """What the index names and is not there. Raises InputError where there is no index."""
    for line in read_index(store.folder).lines:
        entries: list[tuple[Kind, str]] = [("samples", line["key"])]
        entries += [("views", line["view"])] if line["view_files"] else []
        for kind, key in entries:
            if not store.folder_of(kind, key).exists():
                yield Fault(kind, key, "", "missing")


def discard(folder: Path, faults: Sequence[Fault]) -> list[tuple[Kind, str]]:
    """Remove the entries that have a fault; their kinds and keys. Files that belong to no entry stay.

    Notes of quarantine that have one are removed too, so that their views are tried again.
    """
    store, broken = store_of(folder), set[tuple[Kind, str]]()
    for fault in faults:
        if fault.kind == "quarantine":
            store.release(fault.key)
        elif fault.kind != "dataset" and fault.key:
            broken.add((fault.kind, fault.key))
    for kind, key in sorted(broken):
        store.discard(kind, key)
    return sorted(broken)


class Holdings(NamedTuple):
    """What a folder has.  samples : of the dataset, of which are there : so many, with so many bytes, those of the
    files that views share included.  others : samples that an earlier text of the dataset file had."""

    samples: int
    there: int
    bytes: int
    others: int
    others_bytes: int


def holdings(store: Store, plan: DatasetPlan) -> Holdings:
    """By the records of the store: no file is read."""
    sizes, of_views = _bytes_by_key(store, "samples"), _bytes_by_key(store, "views")
    lines = list(plan_lines(plan))
    own = [sizes.pop(line["key"]) for line in lines if line["key"] in sizes]
    shared = [of_views.get(key, 0) for key in dict.fromkeys(line["view"] for line in lines)]
    total = sum(own) + sum(shared)
    return Holdings(len(lines), len(own), total, len(sizes), sum(sizes.values()))


def _bytes_by_key(store: Store, kind: Kind) -> dict[str, int]:
    return {one.key: sum(size for size, _ in one.files.values()) for one in store.scan(kind)}


def store_of(folder: Path) -> Store:
    """The store in a dataset folder. Raises InputError where it is none."""
    refuse_empty(folder, "the folder", "give the folder of a dataset")
    if not any((folder / name).is_file() for name in (FILE, INDEX)):
        raise InputError(
            f"{folder} is no dataset: it has no {FILE}; give a folder that `dataset run` made."
        )
    return Store(folder)
