"""Refuses files that say they unpack to far more than they have, before memory is taken for it."""

from __future__ import annotations

import math
import zipfile
import zlib
from pathlib import Path

import numpy as np

from ..core import InputError

ALWAYS_BYTES = 2**28  # may come out of any file
MOST_RATIO = 200  # of unpacked over stored bytes: frames with noise reach 20, deflate ends at 1032
MAGIC = b"\x93NUMPY"
MOST_ARRAYS = 1000  # in one archive


def require_plausible(path: Path, unpacked_bytes: int) -> None:
    """Raise InputError where the pixels that a header announces cannot be in the file."""
    stored = path.stat().st_size
    if unpacked_bytes > max(ALWAYS_BYTES, MOST_RATIO * stored):
        raise InputError(
            f"{path} has {stored} bytes and says that {unpacked_bytes} come out of them, {MOST_RATIO} times as many at "
            "most are read; it is damaged, or made to fill the memory: write it again, uncompressed if it is right."
        )


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an .npz, none of them pickled. Raises OSError and ValueError for what is none, and InputError for
    one that unpacks to too much."""
    try:
        with zipfile.ZipFile(path) as archive:
            _check(path, archive)
        with np.load(path, allow_pickle=False) as arrays:
            return {name: np.asarray(arrays[name]) for name in arrays.files}
    except (AttributeError, TypeError, EOFError, NotImplementedError, RuntimeError) as error:
        raise ValueError(str(error)) from error
    except (zipfile.BadZipFile, zlib.error, SyntaxError, MemoryError) as error:
        raise ValueError(str(error)) from error


def _check(path: Path, archive: zipfile.ZipFile) -> None:
    """By the headers of the archive and of its arrays."""
    entries = archive.infolist()
    if len(entries) > MOST_ARRAYS:
        raise InputError(f"{path} has {len(entries)} arrays; {MOST_ARRAYS} at most are read.")
    require_plausible(path, sum(entry.file_size for entry in entries))
    for entry in entries:
        with archive.open(entry) as file:
            if file.read(len(MAGIC)) != MAGIC:  # NumPy gives it as it is
                continue
        with archive.open(entry) as file:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, kind = read(file)
        if kind.hasobject or math.prod(shape) * kind.itemsize > entry.file_size:
            raise ValueError(f"{entry.filename} is no array of numbers, or cut short")
