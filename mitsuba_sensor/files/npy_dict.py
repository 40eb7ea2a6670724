"""A dict of numbers in a .npy file, as ``np.save`` writes it: pickled, and read here without any object but numbers.

Python's own reader of pickles runs what they name. Here their codes are read one by one, they may name arrays, numbers
and their types alone, and functions of this file stand for these.
"""

from __future__ import annotations

import pickletools
import tokenize
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeAlias

import numpy as np

from ..core import InputError
from ..core.small_files import require_small

LARGEST_BYTES = 2**20
Value: TypeAlias = Any
"""What a code of a pickle makes: a dict, a list, a tuple, a text, a number, or what stands for a name."""
BROKEN = (
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
"""What broken bytes raise."""


def read_npy_dict(path: Path) -> dict[str, Value]:
    """The dict of a .npy: numbers as float, arrays as nested lists. Raises InputError for everything else."""
    require_small(path, "the file", LARGEST_BYTES)
    try:
        with path.open("rb") as file:
            if _header(file) != ((), np.dtype(object)):
                raise InputError(f"{path} has an array of numbers; give a .npy of one dict.")
            value = _plain(_Machine().load(file.read()))
    except BROKEN as error:
        raise InputError(f"{path} is no .npy of one dict of numbers: {error}.") from None
    if not isinstance(value, dict):
        raise InputError(f"{path} has {type(value).__name__}; give a .npy of one dict.")
    return value


def _header(file: BinaryIO) -> tuple[tuple[int, ...], np.dtype[Value]]:
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

    def fill(self, state: tuple[Value, ...]) -> None:
        """By the state that the pickle has of it."""
        self.order = str(state[1])

    def read(self, data: bytes) -> np.ndarray:
        """The numbers."""
        if self.code not in CODES:
            raise ValueError(f"its numbers are {self.code!r}; they may be {', '.join(CODES)}")
        return np.frombuffer(data, self.order.replace("|", "=") + self.code)


class _Array:
    """An array, as its value: a number, nested lists of them, or the one object that it has."""

    value: Value = None

    def __init__(self, *_: object) -> None:
        pass

    def fill(self, state: tuple[Value, ...]) -> None:
        """By the state that the pickle has of it."""
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


def _plain(value: Value) -> Value:
    """Dicts, lists and numbers of Python."""
    if isinstance(value, dict):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    if isinstance(value, _Array):
        return _plain(value.value)
    return value


class _Machine:
    """Does what the codes of a pickle say, of those that make dicts, lists, texts, numbers and arrays of them."""

    def __init__(self) -> None:
        self.stack: list[Value] = []
        self.marks: list[int] = []
        self.memo: dict[Value, Value] = {}

    def load(self, data: bytes) -> Value:
        """The value of a pickle. Raises ValueError for a code or a name of anything else."""
        for code, argument, _ in pickletools.genops(data):
            if code.name == "STOP":
                break
            if code.name in VALUES:
                self.stack.append(argument)
            elif code.name in MADE:
                self.stack.append(MADE[code.name]())
            elif code.name in ("MEMOIZE", "BINPUT", "LONG_BINPUT"):
                number = len(self.memo)
                if isinstance(argument, int):
                    number = argument
                self.memo[number] = self.stack[-1]
            elif code.name in ("BINGET", "LONG_BINGET"):
                self.stack.append(self.memo[argument])
            elif code.name == "MARK":
                self.marks.append(len(self.stack))
            elif code.name not in ("PROTO", "FRAME"):
                self._combine(code.name, argument)
        return self.stack.pop()

    def _combine(self, code: str, argument: Value) -> None:
        """A code that takes values from the stack."""
        stack = self.stack
        if code == "GLOBAL":
            stack.append(_known(*argument.split(" ")))
        elif code == "STACK_GLOBAL":
            stack.append(_known(*self._take(2)))
        elif code in TUPLES:
            stack.append(tuple(self._take(TUPLES[code])))
        elif code == "TUPLE":
            stack.append(tuple(self._take_marked()))
        elif code in ("APPEND", "APPENDS"):
            parts = self._take(1) if code == "APPEND" else self._take_marked()
            stack[-1].extend(parts)
        elif code in ("SETITEM", "SETITEMS"):
            parts = self._take(2) if code == "SETITEM" else self._take_marked()
            stack[-1].update(zip(parts[::2], parts[1::2], strict=True))
        elif code == "REDUCE":
            made, arguments = self._take(2)
            stack.append(made(*arguments))
        elif code == "BUILD":
            (state,) = self._take(1)
            stack[-1].fill(state)
        else:
            raise ValueError(f"it has the code {code}, which makes no number")

    def _take(self, count: int) -> list[Value]:
        """The topmost values."""
        first = len(self.stack) - count
        parts = self.stack[first:]
        del self.stack[first:]
        return parts

    def _take_marked(self) -> list[Value]:
        """The values above the last mark."""
        return self._take(len(self.stack) - self.marks.pop())


def _known(module: str, name: str) -> Value:
    """What stands for a name in the pickle."""
    known = KNOWN.get((module.replace("numpy._core", "numpy.core"), name))
    if known is None:
        raise ValueError(f"it names {module}.{name}, which is no number")
    return known


VALUES = {
    *("BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT"),
    *("BINUNICODE", "SHORT_BINUNICODE", "BINBYTES", "SHORT_BINBYTES"),
}
MADE: dict[str, Callable[[], Value]] = {
    "EMPTY_DICT": dict,
    "EMPTY_LIST": list,
    "EMPTY_TUPLE": tuple,
    "NONE": lambda: None,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
}
TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
"""Codes of pickles: of values, of what is made empty, of tuples with their lengths."""
CODES = ("f4", "f8", "i2", "i4", "i8", "u1", "u2", "u4")
KNOWN: dict[tuple[str, str], Value] = {
    ("numpy.core.multiarray", "_reconstruct"): _Array,
    ("numpy.core.multiarray", "scalar"): _scalar,
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Type,
    ("_codecs", "encode"): _latin1_bytes,
}
"""Names in pickles of NumPy → what stands for them: nothing of NumPy's own, which broken bytes could confuse."""
