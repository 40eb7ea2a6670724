"""Files that survive a power cut: written to a temporary name, flushed, renamed, and the folder flushed also.

Linux and macOS keep a new name only if its folder is flushed; Windows cannot flush a folder and always keeps the name.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO

from ..stopping import undone_if_stopped, whole_step
from .disk_errors import disk_sentences

SCRATCH = ".unfinished-"
FOLDER_BYTES = 4096
"""Size of a new folder: one block."""
ABANDONED_S = 3600.0
"""Age of an unfinished file whose program was killed."""
REMOVALS_MAX = 50
"""Attempts to remove a folder that another program removes at the same time."""


def scratch_name(parent: Path) -> Path:
    """Return a new name in ``parent`` that no other program uses."""
    return parent / f"{SCRATCH}{secrets.token_hex(8)}"


def flush(path: Path) -> None:
    """Flush the content of a file, or the names in a folder, to the disk."""
    is_folder = path.is_dir()
    if is_folder and not hasattr(os, "O_DIRECTORY"):
        return
    file = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def put_in_place(temporary: Path, path: Path) -> None:
    """Give a finished file its name, so name and content survive a power cut: flush the file, rename it, flush the
    folder. All writers of the package end here, or flush and rename several files at once."""
    flush(temporary)
    os.replace(temporary, path)
    flush(path.parent)


def make_lasting(folder: Path) -> None:
    """Make a folder and its missing parents, so their names survive a power cut."""
    missing = [place for place in (folder, *folder.parents) if not place.is_dir()]
    folder.mkdir(parents=True, exist_ok=True)
    for place in missing:
        flush(place.parent)


@contextmanager
def scratch_file(folder: Path) -> Iterator[Path]:
    """Yield a new path in ``folder``; a file that is still there after the block, or after Ctrl-C, is removed."""
    temporary = scratch_name(folder)
    remove = partial(temporary.unlink, missing_ok=True)
    with undone_if_stopped(remove):
        try:
            yield temporary
        finally:
            with suppress(OSError):  # the folder is a file: reported already
                remove()


def write_lasting(path: Path, chunks: Iterable[bytes]) -> str:
    """Write a file that appears whole, replaces an older one and survives a power cut; return its SHA-256, which also
    replaces {digest} in its name.

    Raises DiskFull, InputError and the errors of ``chunks``; then no file is left.
    """
    digest, size = hashlib.sha256(), 0
    shown = path.with_name(path.name.replace("-{digest}", ""))
    with disk_sentences(shown, FOLDER_BYTES):
        make_lasting(path.parent)
    with scratch_file(path.parent) as temporary:
        with disk_sentences(shown):
            file = temporary.open("xb")
        try:
            for chunk in chunks:
                size += len(chunk)
                digest.update(chunk)
                with disk_sentences(shown, size):
                    file.write(chunk)
        finally:
            with disk_sentences(shown, size):  # writes the last bytes
                file.close()
        with disk_sentences(shown, size), whole_step:
            name = path.name.replace("{digest}", digest.hexdigest())
            put_in_place(temporary, path.with_name(name))
    return digest.hexdigest()


def move_lasting(path: Path, to: Path) -> None:
    """Move a file into another folder, which is made if needed; the move survives a power cut. Raises InputError."""
    with disk_sentences(to, FOLDER_BYTES), suppress(FileNotFoundError):
        make_lasting(to.parent)
        put_in_place(path, to)
        flush(path.parent)


def append_lasting(path: Path, line: bytes) -> None:
    """Append a line to a file in one write, as other programs may do also. Raises DiskFull and InputError."""
    with disk_sentences(path, len(line)), open(path, "ab", buffering=0) as file:
        file.write(line)
        os.fsync(file.fileno())
        if file.tell() == len(line):  # a new file
            flush(path.parent)


def open_to_read(path: Path) -> BinaryIO:
    """Open a file for random access. Raises OSError."""
    return path.open("rb")


def read_small(path: Path, most: int) -> bytes:
    """Return the content of a plain file of at most ``most`` bytes; b"" for a longer one, a pipe or a missing file."""
    with suppress(OSError):
        if path.is_file() and path.stat().st_size <= most:
            with path.open("rb") as file:
                return file.read(most)
    return b""


def remove_file(path: Path) -> None:
    """Remove a file if it exists."""
    path.unlink(missing_ok=True)


def remove_folder(folder: Path) -> None:
    """Remove a folder with its content, or a file of this name, if it exists."""
    for _ in range(REMOVALS_MAX):
        with suppress(FileNotFoundError):
            if folder.is_symlink() or not folder.is_dir():
                folder.unlink(missing_ok=True)
            else:
                shutil.rmtree(folder)
            return


@contextmanager
def scratch_folder(parent: Path) -> Iterator[Path]:
    """Yield a temporary folder, which is removed after the block. Raises DiskFull and InputError."""
    folder = scratch_name(parent)
    with undone_if_stopped(partial(remove_folder, folder)):
        try:
            with disk_sentences(parent, FOLDER_BYTES):
                make_lasting(parent)
                folder.mkdir()
            yield folder
        finally:
            with suppress(OSError):
                remove_folder(folder)


def taken_out(folder: Path) -> dict[str, bytes]:
    """Return name → content of the files in a folder, and remove them."""
    contents = {}
    for name in names_of(folder):
        contents[name] = (folder / name).read_bytes()
        (folder / name).unlink()
    return contents


def remove_unfinished(folder: Path) -> None:
    """Remove the files that killed programs have left in a folder."""
    for name in names_of(folder):
        path = folder / name
        with suppress(OSError):
            if name.startswith(SCRATCH) and time.time() - path.lstat().st_mtime > ABANDONED_S:
                remove_folder(path)


def sha256_of(path: Path | str) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    with open(path, "rb", buffering=0) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def names_of(folder: Path | str) -> list[str]:
    """Return the names in a folder, sorted; [] if there is no such folder."""
    try:
        return sorted(os.listdir(folder))
    except (FileNotFoundError, NotADirectoryError):
        return []
