"""Errors of the operating system as one sentence: DiskFull if no space is left, else InputError."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core import DiskFull, InputError

FULL_NUMBERS = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # disk, quota, largest file
FULL_MESSAGES = (*map(os.strerror, FULL_NUMBERS), "requested and")
"""Parts of messages of OpenEXR and NumPy, whose errors have no number: ``4096 requested and 100 written``."""


@contextmanager
def disk_sentences(target: Path, size: int | None = None) -> Iterator[None]:
    """Turn an OSError, or a name with a null byte, into one sentence that names ``target``: DiskFull or InputError.

    size : size of the file that the block writes [bytes].
    """
    try:
        yield
    except ValueError as error:
        if "null byte" not in str(error):
            raise
        raise InputError(f"{str(target)!r} contains a null byte; give another name.") from error
    except OSError as error:
        if is_full(error):
            raise DiskFull(target, size, error.strerror or os.strerror(errno.ENOSPC)) from error
        raise InputError(
            f"cannot write {target}: {error.strerror or error}; give a writable place."
        ) from error


def is_full(error: OSError) -> bool:
    """Return True if the disk, or the user's quota, is full."""
    return error.errno in FULL_NUMBERS or (
        error.errno is None and any(text in str(error) for text in FULL_MESSAGES)
    )


@contextmanager
def names_in(folder: Path, scratch: Path) -> Iterator[None]:
    """Replace the name of the scratch folder by ``folder`` in the errors of files that cannot be written."""
    try:
        yield
    except DiskFull as error:
        path = error.path
        if path.is_relative_to(scratch):
            path = folder / path.relative_to(scratch)
        raise DiskFull(path, error.size, error.why) from error
    except InputError as error:
        if str(scratch) not in str(error):
            raise
        raise InputError(str(error).replace(str(scratch), str(folder))) from error
