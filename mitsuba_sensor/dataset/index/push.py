"""Puts a dataset of shards into an object store, file by file: whoever reads there finds whole samples at any time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...core import InputError
from ...files import durable
from ...files.objects import Objects, is_address
from ..store.record import FILE, FOR_PEOPLE, INDEX, RECORD, SHARDS
from ..store.shards import shard_called
from .origin import Origin, origin_in, require_origin
from .part import all_parts
from .repair import store_of

Show = Callable[[int, int], object]
EXAMPLE = "s3://bucket/pairs"


@dataclass(frozen=True)
class Pushed:
    """What was uploaded.  files : shards and parts of the index.  bytes : of all files.  there : shards and parts that
    were there already."""

    files: int
    bytes: int
    there: int


def push(folder: Path, address: str, show: Show = lambda done_bytes, all_bytes: None) -> Pushed:
    """Upload what the store does not have of a dataset, which may still grow; push again what was made since.

    Shards come before the parts of the index that name them, pages for people last. Names of shards and parts have
    their SHA-256: what is there with this name and size is not uploaded again, and a changed file is not uploaded.
    address : of the dataset in the store.  show : called with the bytes that are uploaded, and all that will be.
    Raises InputError.
    """
    if not is_address(address):
        raise InputError(
            f"{address!r} is no address of an object store; give e.g. {EXAMPLE}, which fsspec reaches."
        )
    place, origin = Objects(address), _require_shards(folder)
    _require_same(place, origin)
    before, hashed, after = _names(folder)
    sizes = {name: _size(folder, name) for name in (*before, *hashed, *after)}
    lacking = _lacking(place, {name: sizes[name] for name in hashed})
    done, total = 0, sum(sizes[name] for name in (*before, *lacking, *after))
    for name in (*before, *lacking, *after):
        show(done, total)
        if name in hashed:
            _require_hash(folder / name)
        (place / name).put(folder / name)
        done += sizes[name]
    if torn := _lacking(place, {name: sizes[name] for name in hashed}):
        raise InputError(f"{place / torn[0]} has not arrived whole; push again.")
    show(done, total)
    return Pushed(len(lacking), done, len(hashed) - len(lacking))


def _require_shards(folder: Path) -> Origin:
    """What a folder was made from. Raises InputError where its samples are no shards."""
    store_of(folder)
    origin = require_origin(folder)
    if not origin.shard_samples:
        raise InputError(
            f"{folder} has a folder for each sample, and an object store takes shards only; write `store = "
            "{ shard_samples = 1000 }` at the top of the dataset file, and make it in a new folder."
        )
    return origin


def _require_same(place: Objects, origin: Origin) -> None:
    """Raise InputError where another dataset is there, or objects of something else."""
    there = place.sizes()
    if not there:
        return
    other = None
    if RECORD in there:
        other = origin_in(place)
    if other is None:
        raise InputError(f"{place} holds other objects and no dataset; give another address.")
    if other.digest != origin.digest:
        raise InputError(
            f"{place} holds the dataset {other.name!r} of another file or version; give another address."
        )


def _names(folder: Path) -> tuple[list[str], list[str], list[str]]:
    """What is uploaded first, files that have their hashes in their names, and what is uploaded last.

    The index is listed before the shards that it names, and uploaded after them.
    """
    parts = [f"{INDEX}/{part.name}" for part in all_parts(folder)]
    shards = [name for name in durable.names_of(folder / SHARDS) if shard_called(name)]
    pages = [name for name in FOR_PEOPLE if (folder / name).is_file()]
    return [RECORD, FILE], [*(f"{SHARDS}/{name}" for name in shards), *parts], pages


def _size(folder: Path, name: str) -> int:
    try:
        return (folder / name).stat().st_size
    except OSError as error:
        raise _replaced(folder / name) from error


def _lacking(place: Objects, sizes: Mapping[str, int]) -> list[str]:
    """Names of those that are not there with these bytes, in their order."""
    there = {
        f"{kind}/{name}": size
        for kind in (SHARDS, INDEX)
        for name, size in (place / kind).sizes().items()
    }
    return [name for name, size in sizes.items() if there.get(name) != size]


def _require_hash(path: Path) -> None:
    """Raise InputError for a file that is not as its name says."""
    try:
        digest = durable.sha256_of(path)
    except OSError as error:
        raise _replaced(path) from error
    if not path.stem.endswith(f"-{digest}"):
        raise InputError(
            f"{path} is not as it was written; `mitsuba-sensor dataset repair {path.parent.parent}` makes it again."
        )


def _replaced(path: Path) -> InputError:
    return InputError(f"{path} was replaced by a run meanwhile; push again.")
