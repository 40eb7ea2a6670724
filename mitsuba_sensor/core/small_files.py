"""Checks that what is read as a whole is a regular file, and small: no pipe, no gigabytes."""

import stat
from pathlib import Path

from .errors import InputError

MOST_BYTES = 2**24  # of a file that people write: camera, lens, curves, motion


def require_small(path: Path, what: str, most_bytes: int = MOST_BYTES) -> None:
    """Raise InputError for what is no regular file, or has more bytes; OSError where there is none.

    what : the file is, for the message: ``the camera file``.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{what} {path} is no regular file; give the path of one.")
    if found.st_size > most_bytes:
        raise InputError(f"{what} {path} has {found.st_size} bytes; it may have {most_bytes} at most.")
