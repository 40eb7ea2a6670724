"""A dict of numbers in a .npy file, as ``np.save`` writes it: pickled, and read here without any object but numbers.

Reading a pickle runs what it names. Here it may name arrays, numbers and their types alone, which run nothing.
"""

from __future__ import annotations

import io
import pickle
import pickletools
import tokenize
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np

from ..core import InputError
from ..core.small_files import require_small

LARGEST_BYTES = 2**20
BUFFERS = {"BYTEARRAY8", "NEXT_BUFFER", "READONLY_BUFFER"}
"""Codes of pickles that no such dict has, and that allocate what broken bytes say."""
BROKEN = (
    pickle.UnpicklingError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    EOFError,
    MemoryError,
    OverflowError,
    RecursionError,
    SyntaxError,
    tokenize.TokenError,
)
"""What NumPy and pickle raise for broken bytes."""


def read_npy_dict(path: Path) -> dict[str, Any]:
    """The dict of a .npy: numbers as float, arrays as nested lists. Raises InputError for everything else."""
    require_small(path, "the file", LARGEST_BYTES)
    try:
        with path.open("rb") as file:
            if _header(file) != ((), np.dtype(object)):
                raise InputError(f"{path} has an array of numbers; give a .npy of one dict.")
            data = file.read()
        for code, _, _ in pickletools.genops(data):
            if code.name in BUFFERS:
                raise pickle.UnpicklingError(f"it has a {code.name}, which is no number")
        value = _plain(_Numbers(io.BytesIO(data), encoding="latin1").load())
    except BROKEN as error:
        raise InputError(f"{path} is no .npy of one dict of numbers: {error}.") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} has {type(value).__name__}; give a .npy of one dict.")
    return value


def _header(file: BinaryIO) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the array. Raises ValueError for what is no .npy."""
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    version = np.lib.format.read_magic(file)
    if version not in readers:
        raise ValueError(f"version {version} of .npy is not known")
    shape, _, kind = readers[version](file)
    return shape, kind


class _Type:
    """What a pickle says of the numbers of an array: kind and bytes ("f8"), order of the bytes."""

    def __init__(self, code: str, *_: object) -> None:
        self.code, self.order = code, "<"

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.order = str(state[1])

    def read(self, data: bytes) -> np.ndarray:
        """The numbers."""
        if self.code not in CODES:
            raise ValueError(f"its numbers are {self.code!r}; they may be {', '.join(CODES)}")
        return np.frombuffer(data, self.order.replace("|", "=") + self.code)


class _Array:
    """An array, as its value: a number, nested lists of them, or the one object that it has."""

    value: Any = None

    def __init__(self, *_: object) -> None:
        pass

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, kind, is_fortran, data = state
        if isinstance(data, list):
            (self.value,) = data
            return
        order: Literal["F", "C"] = "F" if is_fortran else "C"
        self.value = kind.read(data).reshape(shape, order=order).tolist()


def _scalar(kind: _Type, data: bytes) -> float:
    """A number that is none of an array."""
    return float(kind.read(data)[0])


def _latin1_bytes(text: str, encoding: str) -> bytes:
    """Bytes that a pickle has as text."""
    return text.encode("latin1")


def _plain(value: Any) -> Any:
    """Dicts, lists and numbers of Python."""
    if isinstance(value, dict):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    if isinstance(value, _Array):
        return _plain(value.value)
    return value


class _Numbers(pickle.Unpickler):
    """Reads pickles of dicts, lists, texts, numbers and arrays of them, and refuses the name of everything else."""

    def find_class(self, module: str, name: str) -> Any:
        """What stands for a name in the pickle."""
        known = KNOWN.get((module.replace("numpy._core", "numpy.core"), name))
        if known is None:
            raise pickle.UnpicklingError(f"it names {module}.{name}, which is no number")
        return known


CODES = ("f4", "f8", "i2", "i4", "i8", "u1", "u2", "u4")
KNOWN: dict[tuple[str, str], Any] = {
    ("numpy.core.multiarray", "_reconstruct"): _Array,
    ("numpy.core.multiarray", "scalar"): _scalar,
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Type,
    ("_codecs", "encode"): _latin1_bytes,
}
"""Names in pickles of NumPy → what stands for them: nothing of NumPy's own, which broken bytes could confuse."""
