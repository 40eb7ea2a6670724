"""A dict of numbers in a .npy file, which ``np.save`` pickles, read without running any code of the file.

The pickle may name only NumPy's arrays and numbers; classes of this module replace them.
"""

from __future__ import annotations

import io
import itertools
import pickle
import pickletools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..core import InputError
from ..core.small_files import require_small

BYTES_MAX = 2**20
NUMBERS_MAX = 10**5  # in the whole dict; a list that appears twice counts twice
NUMBER_TYPES = ("f4", "f8", "i2", "i4", "i8", "u1", "u2", "u4")


class _Object:
    """Replacement of an object of NumPy, which only stores arguments and state."""

    state: Any = None

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Dtype(_Object): ...


class _Array(_Object): ...


class _Scalar(_Object): ...


def _latin1(text: str, _: str) -> bytes:
    """Decode bytes that protocol 2 writes as a text."""
    return text.encode("latin1")


STAND_INS: dict[tuple[str, str], Any] = {
    ("numpy.core.multiarray", "_reconstruct"): _Array,
    ("numpy.core.multiarray", "scalar"): _Scalar,
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("_codecs", "encode"): _latin1,
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        replacement = STAND_INS.get((module.replace("numpy._core", "numpy.core"), name))
        if replacement is None:
            raise ValueError(f"it names {module}.{name}, which is not a number")
        return replacement


def read_npy_dict(path: Path) -> dict[str, Any]:
    """Return the dict of a .npy: numbers as float, arrays as nested lists. Raises InputError for other content."""
    require_small(path, "the file", BYTES_MAX)
    data = path.read_bytes()
    try:
        value = _plain(_loaded(data), itertools.count())
    except Exception as error:  # broken bytes raise nearly everything
        raise InputError(f"{path} is not a .npy of one dict of numbers: {error}.") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} has {type(value).__name__}; give a .npy of one dict.")
    return value


def _loaded(data: bytes) -> object:
    """Return the object of a .npy, its arrays as :class:`_Array`. Raises errors of many kinds for broken bytes."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    first = version == (1, 0)
    read = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if shape or dtype != np.dtype(object):
        raise ValueError("it contains an array of numbers")
    for code, argument, _ in pickletools.genops(data[file.tell() :]):  # also checks lengths
        if "PUT" in code.name and int(argument or 0) > len(data):
            raise ValueError("it numbers more objects than it has bytes")
    return _Unpickler(file).load()


def _plain(value: Any, counter: Iterator[int]) -> Any:
    """Return dicts, lists and numbers of Python."""
    if next(counter) > NUMBERS_MAX:
        raise ValueError(f"it has more than {NUMBERS_MAX} numbers")
    if isinstance(value, dict):
        return {str(name): _plain(part, counter) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part, counter) for part in value]
    if isinstance(value, _Scalar):
        return float(_numbers(*value.arguments)[0])
    if isinstance(value, _Array):
        _, shape, dtype, is_fortran, data = value.state
        if isinstance(data, list):  # an array of one object, the dict
            (inner,) = data
        else:
            inner = (
                _numbers(dtype, data).reshape(shape, order="F" if is_fortran else "C").tolist()
            )
        return _plain(inner, counter)
    return value


def _numbers(dtype: _Dtype, data: bytes) -> np.ndarray:
    code, order = dtype.arguments[0], dtype.state[1] if dtype.state else "<"
    if code not in NUMBER_TYPES:
        raise ValueError(f"its numbers are {code!r}; they may be {', '.join(NUMBER_TYPES)}")
    return np.frombuffer(data, order.replace("|", "=") + code)
