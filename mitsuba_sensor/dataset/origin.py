"""What a dataset folder was made from: its file, the versions of what its pixels depend on, and all its samples."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..core import InputError
from ..files import durable, texts
from ..files.appearing import write_drawing
from ..files.scene_references import folder_names
from .faults import Fault, What, what_is_wrong
from .keys import Config, Facts, made_by
from .planned import DatasetPlan, load_plan
from .reader import Index, index_text, lines_digest, read_index
from .record import FILE, INDEX, MOST_BYTES, RECORD, sealed, unsealed
from .store import Store

RESTORE = (
    "give the file that it was made from again: `mitsuba-sensor dataset run FILE.toml -o {}`"
)


class Origin(NamedTuple):
    """What record.json of a dataset folder says; written when the first run begins.

    name : of the dataset.  file : bytes and SHA-256 of dataset.toml.  made_by : versions.  samples : how many a
    complete dataset has.  lines_sha256 : of the index that it has then, whose lines name the key of every sample.
    """

    name: str
    file: tuple[int, str]
    made_by: Config
    samples: int
    lines_sha256: str


def plan_lines(plan: DatasetPlan) -> Iterator[Facts]:
    """The lines of a complete index, in the order of the dataset."""
    for view in plan.views():
        for sample in view.samples:
            shared = {"view": view.key, "split": sample.split, "view_files": bool(view.outputs)}
            yield {"key": sample.key, **shared, "values": dict(sample.values)}


def write_origin(plan: DatasetPlan, folder: Path) -> bool:
    """Write dataset.toml and record.json; whether another dataset.toml was recorded before. Raises InputError."""
    before = origin_in(folder)
    samples, lines_sha256 = lines_digest(
        plan_lines(plan)
    )  # says what is wrong with them before anything is made
    durable.make_folder(folder, folder.parent)
    texts.write_page(folder / FILE, plan.text)
    written = durable.size_and_hash(folder / FILE)
    origin = Origin(plan.file.name, written, plan.made_by, samples, lines_sha256)
    write_drawing(folder / RECORD, sealed(json.dumps({"kind": "dataset", **origin._asdict()})))
    return before is not None and before.file != written


def origin_in(folder: Path) -> Origin | None:
    """What a folder was made from; None where its record is missing or was changed."""
    try:
        text = unsealed(durable.read_small(os.fspath(folder / RECORD), MOST_BYTES))
        if text is not None:
            said = json.loads(text)
        else:
            said = {}
        size, digest = said["file"]
        origin = Origin(
            said["name"], (size, digest), said["made_by"], said["samples"], said["lines_sha256"]
        )
        versions = [*origin.made_by.items()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    texts = [
        origin.name,
        digest,
        origin.lines_sha256,
        *(text for pair in versions for text in pair if text),
    ]
    types = all(isinstance(text, str) and text.isprintable() for text in texts)
    if types and isinstance(size, int) and said["kind"] == "dataset":
        return origin
    return None


def require_origin(folder: Path) -> Origin:
    """What a folder was made from. Raises InputError where its record or its dataset.toml was changed."""
    origin = origin_in(folder)
    if origin is None:
        raise InputError(
            f"{folder / RECORD}, which says what the dataset was made from, is missing or was changed; "
            f"{RESTORE.format(folder)}."
        )
    if what := what_is_wrong(folder / FILE, *origin.file):
        raise InputError(
            f"{folder / FILE} is {what}: it is not what the samples were made from; {RESTORE.format(folder)}, "
            "or the changed one if that is wanted."
        )
    return origin


def require_same_versions(then: Config, folder: Path) -> None:
    """Raise InputError where a folder was made by other versions of what pixels depend on."""
    now = made_by()
    if other := [name for name in now if then.get(name) != now[name]]:
        there = ", ".join(f"{name} {then.get(name)}" for name in other)
        here = ", ".join(f"{name} {now[name]}" for name in other)
        raise InputError(
            f"{folder} was made by {there}, and this is {here}, whose pixels may differ; install what made it, or "
            "give a new folder."
        )


def plan_of(folder: Path, roots: list[str] | None) -> DatasetPlan:
    """The plan that a dataset folder was made from, by the versions that made it.

    roots : folders below which the user lets its files be read; by default the current one, as of a run.
    Raises InputError where anything that it was made from is not the same any more.
    """
    origin = require_origin(folder)
    plan = load_plan(folder / FILE, roots or ["."])
    plan = DatasetPlan(plan.file, plan.roots, plan.text, origin.made_by)
    if lines_digest(plan_lines(plan)) != (origin.samples, origin.lines_sha256):
        raise InputError(
            f"{folder} was made from other files than {FILE} names now below {folder_names(plan.roots)}: a "
            "scene, camera or motion was changed, or its run had other --root folders; restore them and give the "
            f"same --root, or make a dataset of the changed ones: `mitsuba-sensor dataset run FILE.toml -o {folder}`."
        )
    return plan


def write_index(plan: DatasetPlan, store: Store) -> Index:
    """index.jsonl: a line for each sample that is there, in the order of the dataset; returns what it says."""
    lines = [line for line in plan_lines(plan) if store.exists("samples", line["key"])]
    made_from = durable.sha256_of(store.folder / RECORD)
    index = Index(lines, made_from)
    write_drawing(store.folder / INDEX, index_text(index))
    return index


def origin_faults(folder: Path) -> Iterator[Fault]:
    """What is not as it was written of the files that say what a dataset is: its file, its record and its index."""
    origin = origin_in(folder)
    if origin is None:
        yield Fault("dataset", "", RECORD, _missing_or_changed(folder / RECORD))
    elif what := what_is_wrong(folder / FILE, *origin.file):
        yield Fault("dataset", "", FILE, what)
    try:
        index = read_index(folder)
    except InputError:
        yield Fault("dataset", "", INDEX, _missing_or_changed(folder / INDEX))
        return
    if origin is not None and not _belongs(index, origin, folder):
        yield Fault("dataset", "", INDEX, "changed")


def _belongs(index: Index, origin: Origin, folder: Path) -> bool:
    """Whether an index may be that of a dataset; one that is not complete may lack any samples."""
    if index.made_from != durable.sha256_of(folder / RECORD):
        return False
    count, digest = lines_digest(index.lines)
    return count < origin.samples or (count, digest) == (origin.samples, origin.lines_sha256)


def _missing_or_changed(path: Path) -> What:
    if os.path.lexists(path):
        return "changed"
    return "missing"
