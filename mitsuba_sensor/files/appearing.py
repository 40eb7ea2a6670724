"""Files that appear whole or not at all.

:func:`appearing` gives a writer a temporary name in the same folder and renames it at the end, so nobody reads half a
file; :func:`output_folder` does the same for a set of files. What the disk refuses becomes one sentence (InputError).
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from ..core import InputError
from ..stopping import note_written, undone_if_stopped, whole_step
from .disk_errors import disk_sentences, names_in
from .durable import flush, make_lasting, put_in_place

_OF_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/")
"""Beginning of an address like s3://bucket, of whose slashes a path keeps one."""

_REPLACED = dict[Path, tuple[str, ...]]()
"""Names of the files of an earlier result that a folder had when the last files appeared in it."""


def replaced_in(folder: Path | str) -> tuple[str, ...]:
    """Names of the files of an earlier result that the last :func:`output_folder` took away from this folder."""
    return _REPLACED.get(Path(folder), ())


def _refuse_file_name(folder: Path, names: Sequence[str]) -> None:
    """Raise InputError for a new folder with the name of a file, which was probably meant as one."""
    suffixes = {Path(name).suffix for name in names}
    if folder.suffix and folder.suffix.lower() in suffixes and not folder.is_dir():
        raise InputError(
            f"{folder} looks like a file, and the results are several files in a folder; give its name, e.g. "
            f"{folder.with_suffix('')}."
        )


@contextmanager
def output_folder(path: Path | str, names: Sequence[str]) -> Iterator[Path]:
    """Yield a scratch folder; when the block ends well, its files ``names`` appear in ``path``, all of them or none.

    names : of files; one with a ``*`` stands for all files that match it.
    Those of ``names`` that the block did not write are of an older run and no longer stay there.
    Whatever goes wrong, Ctrl-C included, leaves older files in ``path`` as they were and removes what this call made.
    Raises InputError before the block runs if ``path`` cannot take the files.
    """
    refuse_empty(path, "-o", "give the name of a folder, e.g. -o out")
    folder = Path(path)
    _refuse_file_name(folder, names)
    with ExitStack() as stack:
        with whole_step:
            made = _make_folder(folder)
            stack.enter_context(undone_if_stopped(partial(_remove_empty, made)))
        try:
            with disk_sentences(folder), whole_step:
                for name in _matching(names, folder):
                    if (folder / name).is_dir():
                        raise InputError(
                            f"{folder / name} is a folder where a file should go; give another place."
                        )
                scratch = tempfile.TemporaryDirectory(
                    prefix=".unfinished-", dir=folder, ignore_cleanup_errors=True
                )
                stack.enter_context(undone_if_stopped(partial(shutil.rmtree, scratch.name)))
            with scratch:
                with names_in(folder, Path(scratch.name)):
                    yield Path(scratch.name)
                with disk_sentences(folder), whole_step:
                    _publish(
                        Path(scratch.name), folder, _matching(names, folder, Path(scratch.name))
                    )
        except BaseException:
            _remove_empty(made)
            raise


@contextmanager
def output_folders(
    path: str | os.PathLike[str], folders: Iterable[str], names: Sequence[str]
) -> Iterator[dict[str, Path]]:
    """Yield a scratch folder for each of the ``folders`` in ``path``, by its name; see :func:`output_folder`."""
    refuse_empty(path, "-o", "give the name of a folder, e.g. -o out")
    with ExitStack() as stack:
        yield {
            name: stack.enter_context(output_folder(Path(path) / name, names))
            for name in folders
        }


def write_drawing(path: Path, content: bytes) -> None:
    """A file that is already made, a drawn PNG for example."""
    with appearing(path, len(content)) as temporary:
        temporary.write_bytes(content)


@contextmanager
def temporary_copy(name: str, content: bytes, place: str) -> Iterator[Path]:
    """The path of a file with this name and content, for readers that take no bytes.  place : for their messages."""
    with tempfile.TemporaryDirectory(prefix="mitsuba-sensor-") as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        with names_in(Path(place), path):
            yield path


def refuse_empty(path: str | os.PathLike[str], name: str, remedy: str) -> None:
    """Raise InputError for an empty path, which would be the current folder, and for an address.

    name : of the option.
    """
    if not os.fspath(path):
        raise InputError(f"{name} is empty; {remedy}.")
    if _OF_ADDRESS.match(str(path)):
        raise InputError(
            f"{name} is {path}, the address of an object store; copy it to a folder here, or {remedy}."
        )


def require_folder(path: Path | str) -> None:
    """Raise InputError if ``path`` can be no folder, before long work; nothing is made."""
    refuse_empty(path, "-o", "give the name of a folder, e.g. -o out")
    nearest = next(
        place
        for place in (Path(path), *Path(path).absolute().parents)
        if os.path.lexists(place)
    )
    if not nearest.is_dir():
        raise InputError(
            f"cannot write into {path}: a file stands in its place; give another folder."
        )
    if not os.access(nearest, os.W_OK):
        if nearest == Path(path):
            raise InputError(
                f"cannot write into {path}, which is read-only here; let it be written, or give another folder."
            )
        raise InputError(
            f"cannot make the folder {path}: {nearest} cannot be written; give another place."
        )


@contextmanager
def appearing(path: Path, size: int | None = None) -> Iterator[Path]:
    """A temporary name beside ``path`` that becomes ``path`` when the block ends well, and vanishes when not.

    size : of the file, for the error that a full disk is [bytes].
    """
    if not path.name:
        raise InputError(f"cannot write {path}: that is a folder; give the name of a file.")
    if not os.path.lexists(path.parent):
        raise InputError(
            f"cannot write {path}: there is no folder {path.parent}; make it, or give another name."
        )
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with disk_sentences(path, size), undone_if_stopped(temporary.unlink):
            yield temporary
            with whole_step:
                put_in_place(temporary, path)
                note_written(path)
    finally:
        with suppress(OSError):  # a file stands where the folder should be: said already
            temporary.unlink(missing_ok=True)


def _make_folder(folder: Path) -> list[Path]:
    """Make ``folder`` and its parents; the ones that were not there, deepest first."""
    missing = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    try:
        make_lasting(folder)
    except (FileExistsError, NotADirectoryError) as error:
        raise InputError(
            f"cannot write into {folder}: a file stands in its place; give another folder."
        ) from error
    except OSError as error:
        raise InputError(
            f"cannot make the folder {folder}: {error.strerror}; give another place."
        ) from error
    return missing


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove the folders; one that is not empty stays, and those above it."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def _matching(names: Sequence[str], *folders: Path) -> list[str]:
    """The names, with those of the files in these folders in the place of a pattern."""
    found: list[str] = []
    for name in names:
        found += (
            sorted({path.name for folder in folders for path in folder.glob(name)})
            if "*" in name
            else [name]
        )
    return found


def _publish(scratch: Path, folder: Path, names: Sequence[str]) -> None:
    """Rename these files from ``scratch`` into ``folder``, in the place of what stood there; on any failure put that
    back."""
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
