"""A triangle mesh that is put together of boxes, rods and lofts, and becomes a PLY file; lengths in metres, y is up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Vector = Sequence[float]
ROUNDED_DIGITS = 4  # of a coordinate: the same bytes on every machine
POLE_RAD = 0.08  # how near its poles a ball is cut flat


class Mesh:
    """Triangles that are collected piece by piece."""

    def __init__(self) -> None:
        self._points: list[np.ndarray] = []
        self._faces: list[np.ndarray] = []
        self._count = 0

    def add(self, points: np.ndarray, faces: np.ndarray) -> None:
        """Add a piece, (N, 3) points and (M, 3) faces, which count its own points."""
        self._points.append(np.asarray(points, float))
        self._faces.append(np.asarray(faces, int) + self._count)
        self._count += len(points)

    def join(self, other: Mesh) -> None:
        """Add another mesh."""
        self.add(*other.arrays())

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 3) and faces (M, 3) of all pieces."""
        return np.concatenate(self._points), np.concatenate(self._faces)

    def quad(self, a: Vector, b: Vector, c: Vector, d: Vector) -> None:
        """A flat quadrangle, which faces whoever sees its corners against the clock."""
        self.add(np.array([a, b, c, d], float), np.array([[0, 1, 2], [0, 2, 3]]))

    def box(self, low: Vector, high: Vector) -> None:
        """A box along the axes."""
        corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        points = np.asarray(low, float) + corners * (np.asarray(high, float) - low)
        sides = np.array(
            [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        )
        self.add(points, np.concatenate([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]]))

    def skin(self, rings: Sequence[np.ndarray]) -> None:
        """A skin over rings of equally many points, open at both ends."""
        count = len(rings[0])
        around, following = np.arange(count), (np.arange(count) + 1) % count
        faces = []
        for k in range(len(rings) - 1):
            low, high = k * count, (k + 1) * count
            faces.append(np.column_stack([low + around, low + following, high + following]))
            faces.append(np.column_stack([low + around, high + following, high + around]))
        self.add(np.concatenate(rings), np.concatenate(faces))

    def loft(self, rings: Sequence[np.ndarray]) -> None:
        """A skin over rings, closed by a flat cap at each end."""
        self.skin(rings)
        count = len(rings[0])
        around, following = np.arange(count), (np.arange(count) + 1) % count
        middle = np.full(count, count)
        for ring, edge in ((rings[0], (following, around)), (rings[-1], (around, following))):
            points = np.concatenate([ring, [ring.mean(axis=0)]])
            self.add(points, np.column_stack([*edge, middle]))

    def tube(self, path: Sequence[Vector], radii: Sequence[float], count: int = 8) -> None:
        """A round rod along a path, with a radius at each of its points."""
        places = np.asarray(path, float)
        rings = []
        for place, direction, radius in zip(
            places, np.gradient(places, axis=0), radii, strict=True
        ):
            forward = direction / np.linalg.norm(direction)
            side = np.cross(np.eye(3)[np.argmin(np.abs(forward))], forward)
            side /= np.linalg.norm(side)
            rings.append(
                place + radius * circle(count) @ np.array([side, np.cross(forward, side)])
            )
        self.loft(rings)

    def ball(self, centre: Vector, radii: Vector, count: int = 12) -> None:
        """An ellipsoid of so many rings."""
        rings = []
        for angle in np.linspace(POLE_RAD, np.pi - POLE_RAD, count):
            flat = np.sin(angle) * circle(2 * count)
            height = np.full(2 * count, -np.cos(angle))
            ring = np.column_stack([flat[:, 1], height, flat[:, 0]])
            rings.append(np.asarray(centre, float) + ring * np.asarray(radii, float))
        self.loft(rings)

    def moved(self, move: Vector, turn_deg: float = 0.0) -> Mesh:
        """The same, turned about the y axis, then moved."""
        sine, cosine = np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg))
        turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        points, faces = self.arrays()
        result = Mesh()
        result.add(points @ turn.T + np.asarray(move, float), faces)
        return result

    def ply(self) -> bytes:
        """The mesh as a binary PLY file."""
        points, faces = self.arrays()
        rounded = (np.round(points, ROUNDED_DIGITS) + 0.0).astype("<f4")
        rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, faces
        head = (
            "ply\nformat binary_little_endian 1.0\n"
            f"element vertex {len(points)}\n"
            "property float x\nproperty float y\nproperty float z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        return head.encode("ascii") + rounded.tobytes() + rows.tobytes()


def circle(count: int) -> np.ndarray:
    """Points of a circle of radius 1, against the clock, (count, 2)."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def superellipse(half_x: float, half_y: float, power: float, count: int) -> np.ndarray:
    """Points of a closed curve: an ellipse at power 2, nearly a rectangle at a large one, (count, 2)."""
    round_ = circle(count)
    return np.sign(round_) * np.abs(round_) ** (2 / power) * (half_x, half_y)
