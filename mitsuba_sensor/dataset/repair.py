"""Finds what is not as it was written, and makes exactly that again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ..core import InputError
from ..io import files
from ..io.texts import read_json
from .faults import Fault
from .planned import DatasetPlan, plan_below
from .reader import read_index
from .record import FILE, INDEX, ROOTS, Kind
from .store import Store

Show = Callable[[int, int], object]


def verify(folder: Path, show: Show | None = None) -> Iterator[Fault]:
    """Every difference between a dataset folder and what was written: all files are read.

    show : called with the number of entries that are done, and of all.  Raises InputError where there is no dataset.
    """
    store = store_of(folder)
    yield from store.verify_all(show)
    try:
        lines = read_index(folder)
    except InputError:
        yield Fault("dataset", "", INDEX, "changed" if (folder / INDEX).exists() else "missing")
        return
    for line in lines:
        entries: list[tuple[Kind, str]] = [("samples", line["key"])]
        entries += [("views", line["view"])] if line["view_files"] else []
        for kind, key in entries:
            if not store.folder_of(kind, key).exists():
                yield Fault(kind, key, "", "missing")


def discard(folder: Path, faults: Sequence[Fault]) -> list[tuple[Kind, str]]:
    """Remove the entries that have a fault; their kinds and keys. Files that belong to no entry stay."""
    store = store_of(folder)
    broken = sorted({(fault.kind, fault.key) for fault in faults if fault.key and fault.kind != "dataset"})
    for kind, key in broken:
        store.discard(kind, key)
    return broken


class Holdings(NamedTuple):
    """What a folder has.  samples : of the dataset, of which are there : so many, with so many bytes.  others : samples
    that an earlier text of the dataset file had."""

    samples: int
    there: int
    bytes: int
    others: int
    others_bytes: int


def holdings(store: Store, plan: DatasetPlan) -> Holdings:
    """By the records of the store: no file is read."""
    sizes = {one.key: sum(size for size, _ in one.files.values()) for one in store.scan("samples")}
    keys = [sample.key for view in plan.views() for sample in view.samples]
    own = [sizes.pop(key) for key in keys if key in sizes]
    return Holdings(len(keys), len(own), sum(own), len(sizes), sum(sizes.values()))


def store_of(folder: Path) -> Store:
    """The store in a dataset folder. Raises InputError where it is none."""
    files.refuse_empty(folder, "the folder", "give the folder of a dataset")
    if not (folder / FILE).is_file():
        raise InputError(f"{folder} is no dataset: it has no {FILE}; give a folder that `dataset run` made.")
    return Store(folder)


def plan_of(folder: Path, roots: list[str] | None) -> DatasetPlan:
    """The plan that a dataset folder was made from.  roots : in place of those of its run. Raises InputError."""
    known: list[str] = read_json(folder / ROOTS, "give --root")["roots"] if roots is None else roots
    if not all(isinstance(one, str) for one in known):
        raise InputError(f"{folder / ROOTS} was changed; give --root.")
    return plan_below(folder / FILE, known)
