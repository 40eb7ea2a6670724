"""Files that outlive a power cut: written beside their place, flushed, renamed, and the name flushed too.

Linux and macOS keep a new name only when its folder is flushed. Windows, which flushes no folder, keeps it anyway.
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
"""One block, which a new folder takes."""
LEFT_S = 3600.0
"""After its last byte what is unfinished is of a program that was killed."""
TRIES = 50
"""At removing a folder that somebody else removes too."""


def scratch_name(parent: Path) -> Path:
    """A name in ``parent`` that nobody else has."""
    return parent / f"{SCRATCH}{secrets.token_hex(8)}"


def flush(path: Path) -> None:
    """Flush the content of a file, or the names in a folder."""
    is_folder = path.is_dir()
    if is_folder and not hasattr(os, "O_DIRECTORY"):
        return
    file = os.open(path, os.O_RDONLY if is_folder else os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def put_in_place(temporary: Path, path: Path) -> None:
    """Give a finished file its name, so that name and content outlive a power cut from then on: flush the file, rename
    it, flush the folder. All writers of the package end here, or flush and rename several files at once."""
    flush(temporary)
    os.replace(temporary, path)
    flush(path.parent)


def make_lasting(folder: Path) -> None:
    """Make a folder and those above it that are not there, so that their names outlive a power cut."""
    missing = [place for place in (folder, *folder.parents) if not place.is_dir()]
    folder.mkdir(parents=True, exist_ok=True)
    for place in missing:
        flush(place.parent)


def write_lasting(path: Path, chunks: Iterable[bytes]) -> str:
    """A file that appears whole, in the place of an older one, and outlives a power cut from then on. Its SHA-256,
    which stands in its name for {digest}.

    Raises DiskFull and InputError, and whatever the chunks raise; then nothing of it is left.
    """
    digest, size = hashlib.sha256(), 0
    shown = path.with_name(path.name.replace("-{digest}", ""))
    with disk_sentences(shown, FOLDER_BYTES):
        make_lasting(path.parent)
    temporary = scratch_name(path.parent)
    with undone_if_stopped(lambda: temporary.unlink(missing_ok=True)):
        try:
            with disk_sentences(shown):
                file = temporary.open("xb")
            try:
                for chunk in chunks:
                    size += len(chunk)
                    digest.update(chunk)
                    with disk_sentences(shown, size):
                        file.write(chunk)
            finally:
                with disk_sentences(shown, size):  # the last bytes are written here
                    file.close()
            with disk_sentences(shown, size), whole_step:
                name = path.name.replace("{digest}", digest.hexdigest())
                put_in_place(temporary, path.with_name(name))
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
    return digest.hexdigest()


def move_lasting(path: Path, to: Path) -> None:
    """Rename a file into another folder, which is made, so that both names outlive a power cut. Raises InputError."""
    with disk_sentences(to, FOLDER_BYTES), suppress(FileNotFoundError):
        make_lasting(to.parent)
        put_in_place(path, to)
        flush(path.parent)


def append_lasting(path: Path, line: bytes) -> None:
    """Add a line to a file, in one piece, which other programs may do too. Raises DiskFull and InputError."""
    with disk_sentences(path, len(line)), open(path, "ab", buffering=0) as file:
        file.write(line)
        os.fsync(file.fileno())
        if file.tell() == len(line):  # its name is new
            flush(path.parent)


def open_to_read(path: Path) -> BinaryIO:
    """A file that is read by places. Raises OSError."""
    return path.open("rb")


def read_small(path: Path, most: int) -> bytes:
    """Content of a plain file of at most ``most`` bytes; nothing of a longer one, a pipe or a missing one."""
    try:
        if not path.is_file() or path.stat().st_size > most:
            return b""
        with path.open("rb") as file:
            return file.read(most)
    except OSError:
        return b""


def remove_file(path: Path) -> None:
    """Remove a file; that there is none is no error."""
    path.unlink(missing_ok=True)


def remove_folder(folder: Path) -> None:
    """Remove a folder with all that is in it, or whatever else stands there; that nothing does is no error."""
    for _ in range(TRIES):
        with suppress(FileNotFoundError):
            if folder.is_symlink() or not folder.is_dir():
                folder.unlink(missing_ok=True)
            else:
                shutil.rmtree(folder)
            return


@contextmanager
def scratch_folder(parent: Path) -> Iterator[Path]:
    """A folder for what is written for a short time; it goes with the block. Raises DiskFull and InputError."""
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
    """Name → content of the files in a folder, which are removed."""
    found = {}
    for name in names_of(folder):
        found[name] = (folder / name).read_bytes()
        (folder / name).unlink()
    return found


def remove_unfinished(folder: Path) -> None:
    """Remove what programs that were killed have left in a folder."""
    for name in names_of(folder):
        path = folder / name
        with suppress(OSError):
            if name.startswith(SCRATCH) and time.time() - path.lstat().st_mtime > LEFT_S:
                remove_folder(path)


def sha256_of(path: Path | str) -> str:
    """SHA-256 of a file's content in hexadecimal digits."""
    with open(path, "rb", buffering=0) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def size_and_hash(path: Path) -> tuple[int, str]:
    """Bytes of a file, and their SHA-256."""
    return path.stat().st_size, sha256_of(path)


def names_of(folder: Path | str) -> list[str]:
    """Names in a folder, sorted; none if there is no such folder."""
    try:
        return sorted(os.listdir(folder))
    except (FileNotFoundError, NotADirectoryError):
        return []
