"""What a dataset folder was made from: its file, the versions of what its pixels depend on, and all its samples."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ...core import InputError
from ...files import durable, texts
from ...files.appearing import write_drawing
from ...files.objects import Objects, Place, names_in, small_bytes_of
from ..plan.light import FORMAT
from ..plan.planned import DatasetPlan
from ..plan.sources import Sources, read_sources, source_faults
from ..store.faults import Fault, What, what_is_wrong
from ..store.keys import Config, made_by
from ..store.record import FILE, INDEX, MOST_BYTES_OF_DATASET, RECORD, sealed, unsealed
from ..store.shard_size import NUMBERS
from .index import Index
from .part import all_parts, parts_of

RESTORE = (
    "give the file that it was made from again: `mitsuba-sensor dataset run FILE.toml -o {}`"
)


class Origin(NamedTuple):
    """What record.json of a dataset folder says; written when the first run begins.

    name : of the dataset.  file : bytes and SHA-256 of dataset.toml.  made_by : versions.  samples, parts : how many
    samples and parts of the index a complete dataset has.  plan : SHA-256 of what decides the keys of its samples.
    shard_samples : numbers of samples that are one shard; 0 where each sample is a folder.
    sources : the files that the samples are made from.
    """

    name: str
    file: tuple[int, str]
    made_by: Config
    samples: int
    parts: int
    plan: str
    shard_samples: int
    sources: Sources

    @property
    def digest(self) -> str:
        """SHA-256 of all but the text of dataset.toml, whose comments may change: parts of the index have it."""
        return hashlib.sha256(json.dumps(self._replace(file=(0, ""))).encode()).hexdigest()


def origin_of(plan: DatasetPlan, file: tuple[int, str] = (0, "")) -> Origin:
    """What the record of a dataset says.  file : bytes and SHA-256 of dataset.toml."""
    counts = plan.samples, -(-plan.numbers // NUMBERS)
    form = plan.digest, plan.shard_samples
    return Origin(plan.file.name, file, dict(plan.made_by), *counts, *form, plan.sources)


def is_recorded(plan: DatasetPlan, folder: Path) -> bool:
    """Whether a folder says that it was made from this dataset file, and from the same files as this plan."""
    text = plan.text.encode()
    written = len(text), hashlib.sha256(text).hexdigest()
    recorded = origin_in(folder) == origin_of(plan, written)
    return recorded and what_is_wrong(folder / FILE, *written) is None


def write_origin(plan: DatasetPlan, folder: Path) -> bool:
    """Write dataset.toml and record.json where they are others; whether another dataset.toml was recorded before.

    Raises InputError.
    """
    if is_recorded(plan, folder):
        return False
    before = origin_in(folder)
    durable.make_folder(folder, folder.parent)
    texts.write_page(folder / FILE, plan.text)
    origin = origin_of(plan, written := durable.size_and_hash(folder / FILE))
    said = {"kind": "dataset", "format": FORMAT, **origin._asdict()}
    write_drawing(folder / RECORD, sealed(json.dumps(said)))
    return before is not None and before.file != written


def origin_in(folder: Place) -> Origin | None:
    """What a folder was made from; None where its record is missing or was changed."""
    try:
        content = small_bytes_of(folder / RECORD, MOST_BYTES_OF_DATASET)
        said = json.loads(unsealed(content) or "{}")
        kind, format_number = said.pop("kind"), said.pop("format")
        read = {"file": tuple(said["file"]), "sources": read_sources(said["sources"])}
        origin = Origin(**{**said, **read})
        size, digest = origin.file
        versions = [*origin.made_by.items()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    texts = [origin.name, digest, origin.plan, *(x for pair in versions for x in pair if x)]
    numbers = [size, origin.samples, origin.parts, origin.shard_samples]
    whole = all(isinstance(text, str) and text.isprintable() for text in texts)
    whole &= all(isinstance(number, int) for number in numbers)
    if whole and (kind, format_number) == ("dataset", FORMAT):
        return origin
    return None


def require_record(folder: Place) -> Origin:
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


def origin_faults(folder: Path, roots: Sequence[Path]) -> Iterator[Fault]:
    """What is not as it was written of the files that say what a dataset is made from, and of those files.

    roots : folders below which these are sought.
    """
    origin = origin_in(folder)
    if origin is None:
        yield Fault("dataset", "", RECORD, _missing_or_changed(folder / RECORD))
    elif what := what_is_wrong(folder / FILE, *origin.file):
        yield Fault("dataset", "", FILE, what)
    if origin is not None:
        yield from faults_of_sources(origin, [folder, *roots])


def faults_of_sources(origin: Origin, roots: Sequence[Path]) -> Iterator[Fault]:
    """Which files and libraries here are others than those that a dataset was made from and by."""
    now = made_by()
    for name, version in origin.made_by.items():
        if now.get(name) != version:
            yield Fault("library", "", f"{name} {version}", "another version")
    same_package = now["mitsuba-sensor"] == origin.made_by.get("mitsuba-sensor")
    yield from source_faults(origin.sources, roots, same_package)


def index_of(folder: Place) -> Index:
    """The index of a dataset. Raises InputError where there is none, or its record was changed."""
    if not names_in(folder / INDEX):
        raise InputError(_about_no_index(folder))
    return Index(folder, parts_of(require_record(folder).digest, all_parts(folder)).values())


def _about_no_index(folder: Place) -> str:
    """Why a place that has no index is not read, and the way out."""
    if isinstance(folder, Path) and origin_in(folder) is not None:
        return (
            f"{folder} has no index yet, by which samples are read: a run writes it at its end, of large datasets for "
            f"each {NUMBERS} samples; `mitsuba-sensor dataset run` goes on."
        )
    remedy = "make it with `mitsuba-sensor dataset run`"
    if isinstance(folder, Objects):
        remedy = "put one there with `mitsuba-sensor dataset push`"
    return f"{folder} is no dataset that has complete samples; {remedy}."


def _missing_or_changed(path: Path) -> What:
    if os.path.lexists(path):
        return "changed"
    return "missing"
