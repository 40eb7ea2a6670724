"""Files that appear whole or not at all.

:func:`appearing` gives a writer a temporary name in the same folder and renames the file at the end, so no program
reads half a file; :func:`output_folder` does the same for a set of files. Errors of the disk become InputError.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from ..core import InputError
from ..stopping import note_written, undone_if_stopped, whole_step
from .disk_errors import disk_sentences, names_in
from .durable import (
    FOLDER_BYTES,
    flush,
    make_lasting,
    put_in_place,
    scratch_file,
    scratch_folder,
)

_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/")
"""Start of an address like s3://bucket; a path keeps one slash."""

_REPLACED = dict[Path, tuple[str, ...]]()
"""Folder → names of the files that the last files in it replaced."""


def replaced_in(folder: Path | str) -> tuple[str, ...]:
    """Return the names of the files that the last :func:`output_folder` replaced or removed in this folder."""
    return _REPLACED.get(Path(folder), ())


def _refuse_file_name(folder: Path, names: Sequence[str]) -> None:
    """Raise InputError for a new folder whose name looks like the name of a file."""
    suffixes = {Path(name).suffix for name in names}
    if folder.suffix and folder.suffix.lower() in suffixes and not folder.is_dir():
        raise InputError(
            f"{folder} looks like a file, but the results are several files; give the name of a folder, e.g. "
            f"{folder.with_suffix('')}."
        )


@contextmanager
def output_folder(path: Path | str, names: Sequence[str]) -> Iterator[Path]:
    """Yield a scratch folder; when the block ends well, its files ``names`` appear in ``path``, all of them or none.

    names : file names or patterns with ``*``. Older files of these names that the block does not write are removed.
    After an error or Ctrl-C the older files in ``path`` are unchanged, and everything that this call made is removed.
    Raises InputError before the block runs if ``path`` cannot take the files.
    """
    require_folder(path)
    folder = Path(path)
    _refuse_file_name(folder, names)
    with ExitStack() as stack:
        with whole_step, disk_sentences(folder, FOLDER_BYTES):
            made = [one for one in (folder, *folder.parents) if not os.path.lexists(one)]
            make_lasting(folder)
            stack.enter_context(undone_if_stopped(partial(_remove_empty, made)))
        try:
            for name in _matching(names, folder):
                if (folder / name).is_dir():
                    raise InputError(
                        f"{folder / name} is a folder, but must be a file; give another place."
                    )
            with scratch_folder(folder) as scratch:
                with names_in(folder, scratch):
                    yield scratch
                with disk_sentences(folder), whole_step:
                    _publish(scratch, folder, _matching(names, folder, scratch))
        except BaseException:
            _remove_empty(made)
            raise


@contextmanager
def output_folders(
    path: str | os.PathLike[str], folders: Iterable[str], names: Sequence[str]
) -> Iterator[dict[str, Path]]:
    """Yield a scratch folder for each of the ``folders`` in ``path``, by its name; see :func:`output_folder`."""
    require_folder(path)
    with ExitStack() as stack:
        yield {
            name: stack.enter_context(output_folder(Path(path) / name, names))
            for name in folders
        }


def write_drawing(path: Path, content: bytes) -> None:
    """Write the content of a file that is made in memory, e.g. a drawn PNG."""
    with appearing(path, len(content)) as temporary:
        temporary.write_bytes(content)


@contextmanager
def temporary_copy(name: str, content: bytes, place: str) -> Iterator[Path]:
    """Yield the path of a file with this name and content, for readers that take no bytes.  place : for messages."""
    with tempfile.TemporaryDirectory(prefix="mitsuba-sensor-") as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        with names_in(Path(place), path):
            yield path


def refuse_empty(path: str | os.PathLike[str], name: str, remedy: str) -> None:
    """Raise InputError for an empty path, which would be the current folder, and for an address.  name : option."""
    if not os.fspath(path):
        raise InputError(f"{name} is empty; {remedy}.")
    if _ADDRESS.match(str(path)):
        raise InputError(
            f"{name} is {path}, the address of an object store; copy it to a local folder, or {remedy}."
        )


def require_folder(path: str | os.PathLike[str]) -> None:
    """Raise InputError if ``path`` cannot become or be a folder; call before long work, because nothing is made."""
    refuse_empty(path, "out=", "give the name of a folder, e.g. out='out'")
    nearest = next(
        place
        for place in (Path(path), *Path(path).absolute().parents)
        if os.path.lexists(place)
    )
    if not nearest.is_dir():
        raise InputError(
            f"cannot write into {path}, because {nearest} is a file; give another folder."
        )
    if not os.access(nearest, os.W_OK):
        raise InputError(
            f"cannot write into {path}, because {nearest} is read-only; give another folder."
        )


@contextmanager
def appearing(path: Path, size: int | None = None) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; the file becomes ``path`` if the block succeeds, else it is removed.

    size : size of the file, for the error of a full disk [bytes].
    """
    if not path.name:
        raise InputError(
            f"cannot write {path}, because it is a folder; give the name of a file."
        )
    if not os.path.lexists(path.parent):
        raise InputError(
            f"cannot write {path}, because there is no folder {path.parent}; make it, or give another name."
        )
    with disk_sentences(path, size), scratch_file(path.parent) as temporary:
        yield temporary
        with whole_step:
            put_in_place(temporary, path)
            note_written(path)


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove the folders up to the first one that is not empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def _matching(names: Sequence[str], *folders: Path) -> list[str]:
    """Return the names, with each pattern replaced by the names of matching files in these folders."""
    matches = (
        sorted({path.name for folder in folders for path in folder.glob(name)})
        if "*" in name
        else [name]
        for name in names
    )
    return [name for group in matches for name in group]


def _publish(scratch: Path, folder: Path, names: Sequence[str]) -> None:
    """Rename these files from ``scratch`` into ``folder``; if this fails, restore the files that they replace."""
    older, appeared = scratch / "older", [name for name in names if (scratch / name).exists()]
    older.mkdir()
    for name in appeared:
        flush(scratch / name)
    try:
        for name in names:
            if os.path.lexists(folder / name):
                os.replace(folder / name, older / name)
            if name in appeared:
                os.replace(scratch / name, folder / name)
    except BaseException:
        for name in names:
            if os.path.lexists(older / name):
                os.replace(older / name, folder / name)
            elif name in appeared and not (scratch / name).exists():
                (folder / name).unlink(missing_ok=True)
        raise
    flush(folder)
    _REPLACED[folder] = tuple(name for name in names if os.path.lexists(older / name))
    for name in appeared:
        note_written(folder / name)
