"""A folder of many files that appears whole or not at all; nothing is written outside it.

Its file LISTING marks it as an export; a folder without LISTING is never replaced.
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
LISTING_BYTES_MAX = 2**28
"""Enough for more than a million files."""


@contextmanager
def appearing_folder(path: Path, force: bool, facts: Mapping[str, Any]) -> Iterator[Path]:
    """Yield a new folder beside ``path``, which becomes ``path`` if the block succeeds, and is removed if not.

    force : replace a folder that this function has made, if it contains no other files.
    facts : entries of LISTING beside the size and SHA-256 of each file.
    Raises InputError before the block if ``path`` is occupied, and DiskFull.
    """
    refuse_empty(path, "out=", "give the name of a folder, e.g. out='export'")
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
                    name: ((scratch / name).stat().st_size, durable.sha256_of(scratch / name))
                    for name in files_below(scratch)
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
    """Return the path of a file in ``folder``, and make its parents. Raises InputError for other places."""
    parts = PurePosixPath(name).parts
    strange = (
        any(part == ".." or part.startswith(".") for part in parts)
        or not parts
        or not name.isprintable()
    )
    if strange or PurePosixPath(name).is_absolute() or any(letter in name for letter in "\\:"):
        raise InputError(
            f"file name {name!r} is not allowed in an export; give one without .., :, \\ and a leading / or dot."
        )
    place = folder.joinpath(*parts)
    with disk_sentences(place):
        place.parent.mkdir(parents=True, exist_ok=True)
    return place


def files_below(folder: Path) -> list[str]:
    """Return the names of all files below a folder except LISTING, relative to it, with /, sorted."""
    names = (
        place.relative_to(folder).as_posix()
        for place in folder.rglob("*")
        if not place.is_dir()
    )
    return sorted(name for name in names if name != LISTING)


def _require_free(path: Path, force: bool) -> None:
    """Raise InputError unless ``path`` is free, or an export that may be replaced."""
    if not os.path.lexists(path) or (
        path.is_dir() and not path.is_symlink() and not any(path.iterdir())
    ):
        return
    if path.is_symlink() or not path.is_dir():
        raise InputError(f"{path} exists and is not a folder; give another name.")
    listed = _listed(path)
    if listed is None:
        raise InputError(f"{path} exists and is not an export; give the name of a new folder.")
    if not force:
        raise InputError(
            f"{path} exists already; force=True replaces it, or give another name."
        )
    if others := sorted(set(files_below(path)) - listed):
        raise InputError(
            f"{path} contains {others[0]}, which is not part of the export; move it, or give another name."
        )


def _listed(path: Path) -> set[str] | None:
    """Return the files that LISTING names; None if the folder has no valid LISTING."""
    with suppress(ValueError, RecursionError, KeyError, TypeError):
        return set(
            dict(json.loads(durable.read_small(path / LISTING, LISTING_BYTES_MAX))["files"])
        )
    return None


def _publish(scratch: Path, path: Path, force: bool) -> None:
    """Rename the scratch folder to ``path``; an older folder moves away first, and back if this fails."""
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
