"""Bytes that outlive a power cut: folders and files flushed to the disk, read back and hashed, and small files read.

Linux and macOS keep a new name only when its folder is flushed too. Windows, which flushes no folder, keeps it anyway.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import lru_cache
from io import FileIO
from pathlib import Path
from typing import BinaryIO

from ..core import InputError
from .appearing import appearing
from .disk_errors import disk_sentences, names_in

SCRATCH = ".unfinished-"
FOLDER_BYTES = 4096
"""One block, which a new folder takes."""
TRIES = 50
"""At removing a folder that somebody else removes too."""
AT_ONCE = 16
"""Files that are flushed at once."""
READ_SMALL = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)
"""Follows no link, and does not wait for the writer of a pipe."""


def scratch_name(parent: Path) -> Path:
    """A name for a folder in ``parent`` that nobody else has."""
    return parent / f"{SCRATCH}{secrets.token_hex(8)}"


def make_folder(folder: Path, above: Path) -> None:
    """Make ``folder`` and its parents, so that all their names below ``above`` are on the disk."""
    folder.mkdir(parents=True, exist_ok=True)
    for place in (folder, *folder.parents):
        if place == above:
            break
        sync_folder(place.parent)


def make_new(folder: Path) -> None:
    """Make a folder that is not there yet."""
    folder.mkdir()


def make_place(folder: Path) -> None:
    """Make a folder and its parents, whose names are flushed later."""
    folder.mkdir(parents=True, exist_ok=True)


def begin_file(path: Path) -> FileIO:
    """A file that is not there yet, without a buffer."""
    return path.open("xb", buffering=0)


def open_to_read(path: Path) -> BinaryIO:
    """A file that is read by places."""
    return path.open("rb")


def remove_file(path: Path) -> None:
    """Remove a file; that there is none is no error."""
    path.unlink(missing_ok=True)


def write_copy(path: Path, content: bytes) -> None:
    """A file for a short time."""
    path.write_bytes(content)


def sync_folder(folder: Path) -> None:
    """Flush the names in a folder."""
    if hasattr(os, "O_DIRECTORY"):
        file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(file)
        finally:
            os.close(file)


def remove_folder(folder: Path) -> None:
    """Remove a folder with all that is in it, or whatever else stands there; that nothing does is no error."""
    for _ in range(TRIES):
        with suppress(FileNotFoundError):
            if folder.is_symlink() or not folder.is_dir():
                folder.unlink(missing_ok=True)
            else:
                shutil.rmtree(folder)
            return


def sha256_of(path: Path | str) -> str:
    """SHA-256 of a file's content in hexadecimal digits."""
    with open(path, "rb", buffering=0) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def size_and_hash(path: Path) -> tuple[int, str]:
    """Bytes of a file, and their SHA-256."""
    return path.stat().st_size, sha256_of(path)


def flush_folder(folder: Path, files: Mapping[str, tuple[int, str]]) -> None:
    """Flush a folder and these of its files, all at once, and read each file again from the disk.

    files : name → (bytes, SHA-256).
    Raises DiskFull, and InputError if what is read is not what was written.
    """
    pool, jobs = _flushers(os.getpid()), list[Future[None]]()
    try:
        for name, (size, digest) in files.items():
            jobs.append(pool.submit(flush, folder / name, size, digest))
        jobs.append(pool.submit(sync_folder, folder))
        for job in jobs:
            job.result()
    finally:
        wait(jobs)  # also after an error, or a signal: nobody writes there when this has ended


@lru_cache(1)
def _flushers(process: int) -> ThreadPoolExecutor:
    """Threads that flush files: a disk that flushes eight at once takes as long as for one. They are started once for
    each process, as one that is forked has none, which takes half as long as for every folder anew."""
    return ThreadPoolExecutor(AT_ONCE, thread_name_prefix=f"flush-{process}")


def flush(path: Path, size: int, digest: str) -> None:
    """Flush one file, and read it again from the disk.  size, digest : its bytes and their SHA-256."""
    with disk_sentences(path, size):
        file = os.open(path, os.O_RDWR)  # Windows flushes no file that is open for reading
        try:
            os.fsync(file)
            if hasattr(os, "posix_fadvise"):  # forget the copy in memory
                os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(file)
        if size_and_hash(path) != (size, digest):
            raise InputError(
                f"cannot write {path}: it reads back changed; check the disk, or give another place."
            )


def write_new(path: Path, content: bytes) -> None:
    """A small file that is not there yet. Raises DiskFull and InputError."""
    with disk_sentences(path, len(content)), open(path, "xb") as file:
        file.write(content)


def read_small(path: str, most: int) -> bytes:
    """Content of a file of at most ``most`` bytes; nothing of a longer one, a link or a pipe. Raises OSError."""
    file = os.open(path, READ_SMALL)
    try:
        content = os.read(file, most + 1)
    finally:
        os.close(file)
    if len(content) <= most:
        return content
    return b""


def read_plain(path: Path) -> bytes:
    """Content of a file, which is no link and no pipe. Raises OSError."""
    with open(os.open(path, READ_SMALL), "rb", buffering=0) as file:
        return file.read()


def read_end(path: Path, most: int) -> bytes:
    """The last bytes of a file, which is no link and no pipe, at most so many. Raises OSError."""
    with open(os.open(path, READ_SMALL), "rb", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - most, 0))
        return file.read()


def write_lasting(path: Path, content: bytes) -> None:
    """A file that appears whole, in the place of an older one, and outlives a power cut from then on.

    Raises DiskFull and InputError.
    """
    with appearing(path, len(content)) as temporary, names_in(path, temporary):
        temporary.write_bytes(content)
        flush(temporary, len(content), hashlib.sha256(content).hexdigest())
    with disk_sentences(path, FOLDER_BYTES):
        sync_folder(path.parent)


def newest_mtime(folder: Path) -> float:
    """When a folder, or anything in it, was written last [s]; 0 if it is not there any more."""
    paths, newest = [folder], 0.0
    with suppress(OSError):  # it vanishes meanwhile
        paths += folder.rglob("*")
    for path in paths:
        with suppress(OSError):
            newest = max(newest, path.lstat().st_mtime)
    return newest


def clock_of(folder: Path) -> float:
    """The time by the clock that stamps the files in ``folder``, which may be that of a file server [s]."""
    probe = scratch_name(folder)
    try:
        probe.mkdir()
        try:
            return probe.stat().st_mtime
        finally:
            probe.rmdir()
    except OSError:  # a full disk
        return time.time()


def names_of(folder: Path | str) -> list[str]:
    """Names in a folder, sorted; none if there is no such folder."""
    try:
        return sorted(os.listdir(folder))
    except (FileNotFoundError, NotADirectoryError):
        return []


def plain_files(folder: Path | str) -> Iterator[tuple[str, bool]]:
    """(name, whether it is a plain file: no folder, no link) of all that is in a folder, sorted. Raises OSError."""
    with os.scandir(folder) as entries:
        found = [(entry.name, entry.is_file(follow_symlinks=False)) for entry in entries]
    yield from sorted(found)
