"""A folder with many files in it that appears whole or not at all; nothing is written outside of it.

A file that lists what is in it says that the folder is ours: another one is never replaced.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from ..core import InputError
from ..stopping import note_written, undone_if_stopped, whole_step
from . import durable
from .appearing import refuse_empty, require_folder
from .disk_errors import disk_sentences, names_in
from .texts import to_json

LISTING = "files.json"
LONGEST_LISTING = 2**28
"""Bytes: more than a million files have."""


@contextmanager
def appearing_folder(path: Path, force: bool, facts: Mapping[str, Any]) -> Iterator[Path]:
    """Yield a new folder beside ``path``, which becomes ``path`` when the block ends well, and vanishes when not.

    force : replace a folder that this function has made before, with nothing else in it.
    facts : what LISTING says beside the size and SHA-256 of each file.
    Raises InputError before the block if ``path`` is something else, and DiskFull.
    """
    refuse_empty(path, "-o", "give the name of a folder, e.g. -o export")
    _require_free(path, force)
    require_folder(path.parent)
    scratch = durable.scratch_name(path.parent)
    remove = partial(durable.remove_folder, scratch)
    with undone_if_stopped(remove):
        try:
            with disk_sentences(path, durable.FOLDER_BYTES), whole_step:
                durable.make_lasting(scratch)
            with names_in(path, scratch):
                yield scratch
                listed = {
                    name: durable.size_and_hash(scratch / name) for name in files_below(scratch)
                }
                listing = to_json({**facts, "files": listed}).encode()
                durable.write_lasting(scratch / LISTING, [listing, b"\n"])
            with disk_sentences(path), whole_step:
                for place in scratch.rglob("*"):
                    durable.flush(place)
                _publish(scratch, path, force)
                durable.flush(path.parent)
                note_written(path)
        finally:
            with suppress(OSError):
                remove()


def inside(folder: Path, name: str) -> Path:
    """The place of a file in ``folder``; its own folder is made. Raises InputError for a name that leads elsewhere."""
    parts = PurePosixPath(name).parts
    strange = (
        any(part == ".." or part.startswith(".") for part in parts)
        or not parts
        or not name.isprintable()
    )
    if strange or PurePosixPath(name).is_absolute() or any(letter in name for letter in "\\:"):
        raise InputError(
            f"{name!r} is no name of a file in an export; give one without .., :, \\ and a leading / or dot."
        )
    place = folder.joinpath(*parts)
    with disk_sentences(place):
        place.parent.mkdir(parents=True, exist_ok=True)
    return place


def files_below(folder: Path) -> list[str]:
    """Names of all files below a folder, relative to it, with /, sorted; LISTING aside."""
    found = (
        place.relative_to(folder).as_posix()
        for place in folder.rglob("*")
        if not place.is_dir()
    )
    return sorted(name for name in found if name != LISTING)


def _require_free(path: Path, force: bool) -> None:
    """Raise InputError unless nothing stands at ``path``, or a folder of ours that may be replaced."""
    if not os.path.lexists(path) or (
        path.is_dir() and not path.is_symlink() and not any(path.iterdir())
    ):
        return
    if path.is_symlink() or not path.is_dir():
        raise InputError(f"{path} exists and is no folder; give another name.")
    known = _listed(path)
    if known is None:
        raise InputError(f"{path} exists and was not exported; give the name of a new folder.")
    if not force:
        raise InputError(f"{path} exists already; --force replaces it, or give another name.")
    if strange := sorted(set(files_below(path)) - known):
        raise InputError(
            f"{path} has {strange[0]}, which was not exported; move it away, or give another name."
        )


def _listed(path: Path) -> set[str] | None:
    """The files that a folder of ours had, None if it is none."""
    with suppress(OSError, ValueError, RecursionError):
        listing = path / LISTING
        if listing.stat().st_size <= LONGEST_LISTING:
            found = json.loads(listing.read_bytes())
        else:
            found = None
        if isinstance(found, dict) and isinstance(found.get("files"), dict):
            return set(found["files"])
    return None


def _publish(scratch: Path, path: Path, force: bool) -> None:
    """Rename the scratch folder; what it replaces is moved away first, and back if that fails."""
    older = durable.scratch_name(path.parent)
    _require_free(path, force)
    if path.is_dir():
        os.rename(path, older)
    try:
        os.rename(scratch, path)
    except OSError:
        if older.exists():
            os.rename(older, path)
        raise
    durable.remove_folder(older)
