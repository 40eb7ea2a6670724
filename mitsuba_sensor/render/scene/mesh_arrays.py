"""Names of the vertices of a mesh among the parameters of a scene: Mitsuba 3.10 renames them."""

from __future__ import annotations

from collections.abc import Container
from typing import NamedTuple

from ...core import Float64Array

POSITIONS = ("vertex_positions", "positions")  # up to Mitsuba 3.9, and from 3.10 on
NORMALS = ("vertex_normals", "normals")


class VertexArrays(NamedTuple):
    """Names of the parameters that hold the vertices of a mesh.  normals : None where it has none of its own."""

    positions: str
    normals: str | None


def vertex_arrays(parameters: Container[str], shape: str) -> VertexArrays | None:
    """Names of the vertices of a shape, whatever the version of Mitsuba calls them; None for a shape that is no mesh.

    parameters : of the scene, by name.  shape : id of the shape.
    """
    positions, normals = (
        next((f"{shape}.{name}" for name in names if f"{shape}.{name}" in parameters), None)
        for names in (POSITIONS, NORMALS)
    )
    return None if positions is None else VertexArrays(positions, normals)


def moved_vertices(key: str, at_rest: Float64Array, displacement: Float64Array) -> Float64Array:
    """Positions or normals (N, 3) after a displacement, 4×4; normals only turn.  key : name of their parameter."""
    turned = at_rest @ displacement[:3, :3].T
    is_position = key.rpartition(".")[2] in POSITIONS
    return turned + displacement[:3, 3] if is_position else turned
