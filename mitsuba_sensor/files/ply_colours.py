"""Range of the vertex colours in a PLY file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from ..core import Float64Array

TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
TYPES |= {
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
}
TYPES |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
COLOUR = re.compile(r"(.*_)?(r|g|b|red|green|blue)")
HEADER_LINES_MAX = 200
VERTICES_MAX = 2**32  # indices of faces have 32 bits


class _Vertices(NamedTuple):
    """Format of the vertices.

    order : byte order; "" for text.  number : number of vertices.  fields : name and type of each number of a vertex.
    """

    order: str
    number: int
    fields: list[tuple[str, str]]


def largest_colour(path: Path) -> float | None:
    """Return the largest red, green or blue of all vertices.

    None without colours, if the vertices do not come first or contain lists, and for a damaged file, which Mitsuba
    rejects when it reads the mesh.
    """
    with path.open("rb") as file:
        vertices = _header(file)
        if vertices is None:
            return None
        names = [name for name, _ in vertices.fields if COLOUR.fullmatch(name)]
        if not names:
            return None
        try:
            return float(_columns(file, vertices, names).max())
        except ValueError:  # too few numbers, or no number
            return None


def _header(file: IO[bytes]) -> _Vertices | None:
    """Read the header; return the format of the vertices if they are the first element."""
    order, count, fields = "", -1, list[tuple[str, str]]()
    for _ in range(HEADER_LINES_MAX):
        match file.readline(1000).decode("ascii", "replace").split():
            case ["format", name, *_]:
                order = ORDERS.get(name, "")
            case ["element", "vertex", number] if count < 0 and number.isdecimal():
                count = int(number)
            case ["element", *_] if count < 0:
                return None
            case ["element", *_] | ["end_header"]:
                break
            case ["property", kind, name] if kind in TYPES:
                fields.append((name, f"{order}{TYPES[kind]}"))
            case ["property", *_]:
                return None
    else:
        return None
    file.seek(0)
    lines = (file.readline(1000).strip() for _ in range(HEADER_LINES_MAX))
    return (
        _Vertices(order, count, fields)
        if b"end_header" in lines and 0 < count <= VERTICES_MAX
        else None
    )


def _columns(file: IO[bytes], vertices: _Vertices, names: list[str]) -> Float64Array:
    """Return the numbers of these names, shape (vertices, names). Raises ValueError for a damaged file."""
    if vertices.order:
        kind = np.dtype(vertices.fields)
        table = np.frombuffer(file.read(), kind, vertices.number)
        return np.stack([table[name].astype(np.float64) for name in names], axis=1)
    numbers = [name for name, _ in vertices.fields]
    chosen = [numbers.index(name) for name in names]
    return np.loadtxt(file, usecols=chosen, max_rows=vertices.number, ndmin=2)
