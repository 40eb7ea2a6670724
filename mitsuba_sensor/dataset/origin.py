"""What a dataset folder was made from: its file, the versions of what its pixels depend on, and all its samples."""

from __future__ import annotations

import hashlib
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
from .index import Index
from .index_part import NUMBERS, all_parts, parts_of
from .keys import Config, made_by
from .light import FORMAT
from .planned import DatasetPlan, load_plan
from .record import FILE, INDEX, MOST_BYTES, RECORD, sealed, unsealed

RESTORE = (
    "give the file that it was made from again: `mitsuba-sensor dataset run FILE.toml -o {}`"
)


class Origin(NamedTuple):
    """What record.json of a dataset folder says; written when the first run begins.

    name : of the dataset.  file : bytes and SHA-256 of dataset.toml.  made_by : versions.  samples, parts : how many
    samples and parts of the index a complete dataset has.  plan : SHA-256 of what decides the keys of its samples.
    """

    name: str
    file: tuple[int, str]
    made_by: Config
    samples: int
    parts: int
    plan: str

    @property
    def digest(self) -> str:
        """SHA-256 of all but the text of dataset.toml, whose comments may change: parts of the index have it."""
        return hashlib.sha256(json.dumps(self._replace(file=(0, ""))).encode()).hexdigest()


def origin_of(plan: DatasetPlan, file: tuple[int, str] = (0, "")) -> Origin:
    """What the record of a dataset says.  file : bytes and SHA-256 of dataset.toml."""
    counts = plan.samples, -(-plan.numbers // NUMBERS)
    return Origin(plan.file.name, file, dict(plan.made_by), *counts, plan.digest)


def write_origin(plan: DatasetPlan, folder: Path) -> bool:
    """Write dataset.toml and record.json; whether another dataset.toml was recorded before. Raises InputError."""
    before = origin_in(folder)
    durable.make_folder(folder, folder.parent)
    texts.write_page(folder / FILE, plan.text)
    origin = origin_of(plan, written := durable.size_and_hash(folder / FILE))
    said = {"kind": "dataset", "format": FORMAT, **origin._asdict()}
    write_drawing(folder / RECORD, sealed(json.dumps(said)))
    return before is not None and before.file != written


def origin_in(folder: Path) -> Origin | None:
    """What a folder was made from; None where its record is missing or was changed."""
    try:
        text = unsealed(durable.read_small(os.fspath(folder / RECORD), MOST_BYTES))
        said = json.loads(text or "{}")
        kind, format_number = said.pop("kind"), said.pop("format")
        origin = Origin(**{**said, "file": tuple(said["file"])})
        size, digest = origin.file
        versions = [*origin.made_by.items()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    texts = [origin.name, digest, origin.plan, *(x for pair in versions for x in pair if x)]
    numbers = [size, origin.samples, origin.parts]
    whole = all(isinstance(text, str) and text.isprintable() for text in texts)
    whole &= all(isinstance(number, int) for number in numbers)
    if whole and (kind, format_number) == ("dataset", FORMAT):
        return origin
    return None


def require_record(folder: Path) -> Origin:
    """What a folder was made from. Raises InputError where its record is missing or was changed."""
    origin = origin_in(folder)
    if origin is None:
        raise InputError(
            f"{folder / RECORD}, which says what the dataset was made from, is missing, was changed, or is of an "
            f"earlier version; {RESTORE.format(folder)}."
        )
    return origin


def require_origin(folder: Path) -> Origin:
    """The same. Raises InputError where its dataset.toml was changed, too."""
    origin = require_record(folder)
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
    if origin_of(plan, origin.file) != origin:
        raise InputError(
            f"{folder} was made from other files than {FILE} names now below {folder_names(plan.roots)}: a "
            "scene, camera or motion was changed, or its run had other --root folders; restore them and give the "
            f"same --root, or make a dataset of the changed ones: `mitsuba-sensor dataset run FILE.toml -o {folder}`."
        )
    return plan


def origin_faults(folder: Path) -> Iterator[Fault]:
    """What is not as it was written of the files that say what a dataset is made from."""
    origin = origin_in(folder)
    if origin is None:
        yield Fault("dataset", "", RECORD, _missing_or_changed(folder / RECORD))
    elif what := what_is_wrong(folder / FILE, *origin.file):
        yield Fault("dataset", "", FILE, what)


def index_of(folder: Path) -> Index:
    """The index of a dataset folder. Raises InputError where there is none, or its record was changed."""
    if not durable.names_of(folder / INDEX):
        raise InputError(
            f"{folder} is no dataset that has complete samples; make it with `mitsuba-sensor dataset run`."
        )
    return Index(folder, parts_of(require_record(folder).digest, all_parts(folder)).values())


def _missing_or_changed(path: Path) -> What:
    if os.path.lexists(path):
        return "changed"
    return "missing"
