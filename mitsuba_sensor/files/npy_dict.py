"""A dict of numbers in a .npy file, as ``np.save`` writes it: pickled, and read here without running anything.

Names in the pickle may be those of NumPy's arrays and numbers alone, and classes of this file stand for them.
"""

from __future__ import annotations

import io
import itertools
import pickle
import pickletools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ..core import InputError
from ..core.small_files import require_small

BYTES_MAX = 2**20
NUMBERS_MAX = 10**5  # in the whole dict; a list that a pickle names twice counts twice
NUMBER_TYPES = ("f4", "f8", "i2", "i4", "i8", "u1", "u2", "u4")


class _Inert:
    """What stands for a name: it takes no state, so that a pickle changes nothing in this process."""

    def __setstate__(self, state: object) -> NoReturn:
        raise ValueError("it has a state where NumPy writes none")


class _Dtype(_Inert):
    def __init__(self, code: str, *_: object) -> None:
        self.code, self.order = code, "<"

    def __setstate__(self, state: tuple[Any, ...]) -> None:  # type: ignore[override]
        self.order = str(state[1]).replace("|", "=")

    def numbers(self, data: bytes) -> np.ndarray:
        if self.code not in NUMBER_TYPES:
            raise ValueError(
                f"its numbers are {self.code!r}; they may be {', '.join(NUMBER_TYPES)}"
            )
        return np.frombuffer(data, self.order + self.code)


class _Array(_Inert):
    value: Any = None

    def __init__(self, *_: object) -> None: ...

    def __setstate__(self, state: tuple[Any, ...]) -> None:  # type: ignore[override]
        _, shape, dtype, is_fortran, data = state
        if isinstance(data, list):  # an array of one object, the dict
            (self.value,) = data
        else:
            array = dtype.numbers(data).reshape(shape, order="F" if is_fortran else "C")
            self.value = array.tolist()


class _Scalar(_Array):
    def __init__(self, dtype: _Dtype, data: bytes) -> None:
        self.value = float(dtype.numbers(data)[0])


class _Latin1(_Array):  # bytes that protocol 2 writes as a text
    def __new__(cls, text: str, encoding: str) -> bytes:  # type: ignore[misc]
        return text.encode("latin1")


STAND_INS: dict[tuple[str, str], type] = {
    ("numpy.core.multiarray", "_reconstruct"): _Array,
    ("numpy.core.multiarray", "scalar"): _Scalar,
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("_codecs", "encode"): _Latin1,
}


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> type:
        known = STAND_INS.get((module.replace("numpy._core", "numpy.core"), name))
        if known is None:
            raise ValueError(f"it names {module}.{name}, which is no number")
        return known


def read_npy_dict(path: Path) -> dict[str, Any]:
    """The dict of a .npy: numbers as float, arrays as nested lists. Raises InputError for everything else."""
    require_small(path, "the file", BYTES_MAX)
    data = path.read_bytes()
    try:
        value = _plain(_loaded(data), itertools.count())
    except Exception as error:  # broken bytes raise nearly everything
        raise InputError(f"{path} is no .npy of one dict of numbers: {error}.") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} has {type(value).__name__}; give a .npy of one dict.")
    return value


def _loaded(data: bytes) -> object:
    """The object of a .npy, its arrays as :class:`_Array`. Raises ValueError and what broken bytes raise."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    readers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    shape, _, dtype = readers[version](file)
    if shape or dtype != np.dtype(object):
        raise ValueError("it has an array of numbers")
    for code, argument, _ in pickletools.genops(
        data[file.tell() :]
    ):  # lengths that the bytes do not have raise here
        if "PUT" in code.name and int(argument or 0) > len(data):
            raise ValueError("it numbers more objects than it has bytes")
    return _Unpickler(file).load()


def _plain(value: Any, counter: Iterator[int]) -> Any:
    """Dicts, lists and numbers of Python."""
    if next(counter) > NUMBERS_MAX:
        raise ValueError(f"it has more than {NUMBERS_MAX} numbers")
    if isinstance(value, dict):
        return {str(name): _plain(part, counter) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part, counter) for part in value]
    return _plain(value.value, counter) if isinstance(value, _Array) else value
