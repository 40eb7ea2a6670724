"""NumPy archives (.npz) of arrays of numbers, none of them pickled; FPN maps by name are one."""

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


MOST_ARRAYS = 1000  # in one archive


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an .npz, none of them pickled. Raises OSError and ValueError for what is none, and InputError for
    one that unpacks to too much."""
    try:
        require_regular(path)
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
            if version == (1, 0):
                read = np.lib.format.read_array_header_1_0
            else:
                read = np.lib.format.read_array_header_2_0
            shape, _, kind = read(file)
        if kind.hasobject or math.prod(shape) * kind.itemsize > entry.file_size:
            raise ValueError(f"{entry.filename} is no array of numbers, or cut short")


def write_fpn_maps(path: Path, maps: Mapping[str, np.ndarray]) -> None:
    """FPN maps by name as a NumPy .npz; :func:`read_fpn_maps` is its inverse."""
    size = sum(values.nbytes for values in maps.values())
    with appearing(path, size) as temporary, temporary.open("wb") as file:
        np.savez(file, **maps)  # type: ignore[arg-type]


def read_fpn_maps(path: Path) -> dict[str, np.ndarray]:
    """What :func:`write_fpn_maps` wrote, or maps of a real sensor under the same names. Raises InputError."""
    try:
        return read_arrays(Path(path))
    except InputError:
        raise
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is no .npz of numbers"
        raise InputError(
            f"the FPN maps {path} cannot be read: {why}; make one with `mitsuba-sensor fpn-maps`."
        ) from None
