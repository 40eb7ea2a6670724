"""What the operating system refuses, as one sentence: DiskFull where no place is left, else InputError."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core import DiskFull, InputError

FULL = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # a disk, or what one user may have of it
SAID_OF_FULL = (
    os.strerror(errno.ENOSPC),
    os.strerror(errno.EDQUOT),
    os.strerror(errno.EFBIG),
    "requested and",
)
"""Of OpenEXR and NumPy, whose errors have no number: ``4096 requested and 100 written``."""


@contextmanager
def disk_sentences(target: Path, size: int | None = None) -> Iterator[None]:
    """Turn what the operating system refuses into one sentence that names ``target``: InputError, or DiskFull.

    size : of the file that the block writes [bytes].
    """
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        if is_full(error):
            raise DiskFull(target, size, error.strerror or os.strerror(errno.ENOSPC)) from error
        raise InputError(
            f"cannot write {target}: {why}; give a place that can be written."
        ) from error


def is_full(error: OSError) -> bool:
    """Whether the disk has no place left, or none for this user."""
    return error.errno in FULL or (
        error.errno is None and any(said in str(error) for said in SAID_OF_FULL)
    )


@contextmanager
def names_in(folder: Path, scratch: Path) -> Iterator[None]:
    """Of files that cannot be written say where they were to be, not the name of the scratch folder."""
    try:
        yield
    except DiskFull as error:
        if error.path.is_relative_to(scratch):
            path = folder / error.path.relative_to(scratch)
        else:
            path = error.path
        raise DiskFull(path, error.size, error.why) from error
    except InputError as error:
        if str(scratch) not in str(error):
            raise
        raise InputError(str(error).replace(str(scratch), str(folder))) from error
