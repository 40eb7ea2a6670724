"""NumPy archives (.npz) of arrays of numbers without pickles, e.g. FPN maps by name."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..core import InputError
from ..core.small_files import require_plausible, require_regular
from .appearing import appearing

MAGIC = b"\x93NUMPY"
ARRAYS_MAX = 1000  # in one archive
BROKEN = (
    *(AttributeError, TypeError, EOFError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, SyntaxError, MemoryError),
)
"""Errors that zipfile and NumPy raise for broken archives."""


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an .npz without pickles. Raises OSError and ValueError for other files, and InputError if
    the arrays are too large."""
    try:
        require_regular(path)
        with zipfile.ZipFile(path) as archive:
            _check(path, archive)
        with np.load(path, allow_pickle=False) as arrays:
            return {name: np.asarray(arrays[name]) for name in arrays.files}
    except BROKEN as error:
        raise ValueError(str(error)) from error


def _check(path: Path, archive: zipfile.ZipFile) -> None:
    """Check the headers of the archive and of its arrays. Raises InputError and ValueError."""
    entries = archive.infolist()
    if len(entries) > ARRAYS_MAX:
        raise InputError(f"{path} has {len(entries)} arrays; at most {ARRAYS_MAX} are allowed.")
    require_plausible(path, sum(entry.file_size for entry in entries))
    for entry in entries:
        with archive.open(entry) as file:
            if file.read(len(MAGIC)) != MAGIC:  # NumPy returns its bytes
                continue
        with archive.open(entry) as file:
            version = np.lib.format.read_magic(file)
            first = version == (1, 0)
            read = (
                np.lib.format.read_array_header_1_0
                if first
                else np.lib.format.read_array_header_2_0
            )
            shape, _, kind = read(file)
        if kind.hasobject or math.prod(shape) * kind.itemsize > entry.file_size:
            raise ValueError(f"{entry.filename} is not an array of numbers, or is cut short")


def write_fpn_maps(path: Path, maps: Mapping[str, np.ndarray]) -> None:
    """Write FPN maps by name as a NumPy .npz; :func:`read_fpn_maps` is the inverse."""
    size = sum(values.nbytes for values in maps.values())
    with appearing(path, size) as temporary, temporary.open("wb") as file:
        np.savez(file, **maps)  # type: ignore[arg-type]


def read_fpn_maps(path: Path) -> dict[str, np.ndarray]:
    """Return the maps of :func:`write_fpn_maps`, or maps of a real sensor with the same names. Raises InputError."""
    try:
        return read_arrays(Path(path))
    except InputError:
        raise
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is not a .npz of numbers"
        raise InputError(
            f"the FPN maps {path} cannot be read: {why}; make one with `mitsuba-sensor fpn-maps`."
        ) from None
