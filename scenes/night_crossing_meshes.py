"""Meshes and textures of night_crossing.xml: facades, a car, a person, trees; lengths in metres, y is up.

All of it is computed here. make_night_crossing.py says where the things stand and writes them to files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

Vector = Sequence[float]
ROUNDED_M = 4  # digits of a coordinate, so that the same bytes are written on every machine


@dataclass
class Mesh:
    """Triangles that are collected piece by piece.  points : of each piece, (N, 3).  faces : (M, 3)."""

    points: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)

    def add(self, points: np.ndarray, faces: np.ndarray) -> None:
        """Add a piece; its faces count its own points."""
        first = sum(len(piece) for piece in self.points)
        self.points.append(np.asarray(points, float))
        self.faces.append(np.asarray(faces, int) + first)

    def quad(self, a: Vector, b: Vector, c: Vector, d: Vector) -> None:
        """A flat quadrangle, which faces whoever sees its corners against the clock."""
        self.add(np.array([a, b, c, d], float), np.array([[0, 1, 2], [0, 2, 3]]))

    def box(self, low: Vector, high: Vector) -> None:
        """A box along the axes."""
        corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        points = np.asarray(low, float) + corners * (np.asarray(high, float) - low)
        sides = [
            (0, 1, 3, 2),
            (4, 6, 7, 5),
            (0, 4, 5, 1),
            (2, 3, 7, 6),
            (0, 2, 6, 4),
            (1, 5, 7, 3),
        ]
        self.add(points, np.array([f for a, b, c, d in sides for f in ((a, b, c), (a, c, d))]))

    def loft(self, rings: Sequence[np.ndarray]) -> None:
        """A closed skin over rings of equally many points, with a flat cap at each end."""
        count = len(rings[0])
        points = np.concatenate([*rings, [rings[0].mean(axis=0)], [rings[-1].mean(axis=0)]])
        faces = []
        around = np.arange(count)
        following = (around + 1) % count
        for k in range(len(rings) - 1):
            lower, upper = k * count, (k + 1) * count
            faces.append(
                np.column_stack([lower + around, lower + following, upper + following])
            )
            faces.append(np.column_stack([lower + around, upper + following, upper + around]))
        first, last, top = len(points) - 2, len(points) - 1, (len(rings) - 1) * count
        faces.append(np.column_stack([following, around, np.full(count, first)]))
        faces.append(np.column_stack([top + around, top + following, np.full(count, last)]))
        self.add(points, np.concatenate(faces))

    def tube(self, path: Sequence[Vector], radii: Sequence[float], count: int = 8) -> None:
        """A round rod along a path, with a radius at each of its points."""
        places = np.asarray(path, float)
        directions = np.gradient(places, axis=0)
        rings = []
        for place, direction, radius in zip(places, directions, radii, strict=True):
            forward = direction / np.linalg.norm(direction)
            helper = np.eye(3)[np.argmin(np.abs(forward))]
            side = np.cross(helper, forward)
            side /= np.linalg.norm(side)
            rings.append(
                place + radius * circle(count) @ np.array([side, np.cross(forward, side)])
            )
        self.loft(rings)

    def ball(self, centre: Vector, radii: Vector, count: int = 12) -> None:
        """An ellipsoid."""
        polar = np.linspace(0.08, np.pi - 0.08, count)
        rings = []
        for angle in polar:
            flat = np.sin(angle) * circle(2 * count)
            height = np.full(2 * count, -np.cos(angle))
            ring = np.column_stack([flat[:, 1], height, flat[:, 0]])
            rings.append(np.asarray(centre, float) + ring * np.asarray(radii, float))
        self.loft(rings)

    def moved(
        self, turn_deg: float = 0.0, move: Vector = (0, 0, 0), scale: float = 1.0
    ) -> Mesh:
        """The same, scaled, then turned about the y axis, then moved."""
        angle = np.radians(turn_deg)
        turn = np.array(
            [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        )
        points, faces = self.arrays()
        return Mesh([scale * points @ turn.T + np.asarray(move, float)], [faces])

    def joined(self, other: Mesh) -> Mesh:
        """Both meshes as one."""
        result = Mesh([self.arrays()[0]], [self.arrays()[1]])
        result.add(*other.arrays())
        return result

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 3) and faces (M, 3) of all pieces."""
        return np.concatenate(self.points), np.concatenate(self.faces)

    def ply(self) -> bytes:
        """The mesh as a binary PLY file."""
        points, faces = self.arrays()
        rounded = (np.round(points, ROUNDED_M) + 0.0).astype("<f4")
        rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, faces
        head = (
            "ply\nformat binary_little_endian 1.0\n"
            f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        return head.encode("ascii") + rounded.tobytes() + rows.tobytes()


def circle(count: int) -> np.ndarray:
    """Points of a circle of radius 1, against the clock, (count, 2)."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def rounded_rectangle(half_x: float, half_y: float, power: float, count: int) -> np.ndarray:
    """Points of a superellipse: power 2 is an ellipse, a large one a rectangle, (count, 2)."""
    flat = circle(count)
    shaped = np.sign(flat) * np.abs(flat) ** (2 / power)
    return shaped * (half_x, half_y)


# --- houses ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Facade:
    """A wall with rows of windows.  lit : (floor, column) → the name of what shines there.

    origin : lower left corner, as seen from the street.  along : direction to the right.
    """

    origin: Vector
    along: Vector
    columns: int
    floors: int
    lit: dict[tuple[int, int], str]
    column_m: float = 2.7
    ground_m: float = 4.2
    floor_m: float = 3.3
    shop: str = ""

    @property
    def width_m(self) -> float:
        return self.columns * self.column_m

    @property
    def height_m(self) -> float:
        return self.ground_m + self.floors * self.floor_m + 0.6

    def place(self, right: float, up: float, out: float) -> np.ndarray:
        """World point of a place on the wall; out is towards the street."""
        direction = np.asarray(self.along, float)
        outwards = np.cross(direction, (0, 1, 0))
        return np.asarray(self.origin, float) + right * direction + (0, up, 0) + out * outwards

    def panel(self, mesh: Mesh, right: Vector, up: Vector, out: float) -> None:
        """A flat rectangle parallel to the wall that faces the street."""
        (left, end), (low, high) = right, up
        corners = [(left, low), (end, low), (end, high), (left, high)]
        mesh.quad(*(self.place(r, u, out) for r, u in corners))

    def ledge(self, mesh: Mesh, right: Vector, up: Vector, out: Vector) -> None:
        """A beam that lies along the wall."""
        (left, end), (low, high), (back, front) = right, up, out
        self.panel(mesh, right, up, front)
        here, there = (left, end), (low, high)
        for u, flip in zip(there, (False, True), strict=True):
            corners = [
                self.place(r, u, o)
                for r, o in ((left, back), (end, back), (end, front), (left, front))
            ]
            mesh.quad(*(corners[::-1] if flip else corners))
        for r in here:
            mesh.quad(
                *(
                    self.place(r, u, o)
                    for u, o in ((low, back), (low, front), (high, front), (high, back))
                )
            )

    def build(self, parts: dict[str, Mesh], wall: str) -> None:
        """Add the wall, its windows and its ledges to the meshes of these names."""
        for floor in range(self.floors):
            for column in range(self.columns):
                left, low = column * self.column_m, self.ground_m + floor * self.floor_m
                self._cell(parts, wall, (floor, column), (left, low))
        top = self.ground_m + self.floors * self.floor_m
        self.panel(parts[wall], (0, self.width_m), (top, self.height_m), 0)
        self.ledge(
            parts["trim"], (-0.15, self.width_m + 0.15), (top + 0.25, top + 0.6), (-0.3, 0.4)
        )
        self.ledge(
            parts["trim"],
            (0, self.width_m),
            (self.ground_m - 0.35, self.ground_m - 0.1),
            (0, 0.16),
        )
        if self.shop:
            self._shop(parts, wall)
        else:
            self._ground_floor(parts, wall)

    def _cell(
        self,
        parts: dict[str, Mesh],
        wall: str,
        key: tuple[int, int],
        corner: tuple[float, float],
    ) -> None:
        """A window in its piece of wall: pane behind the wall, bars, sill."""
        left, low = corner
        end, high = left + self.column_m, low + self.floor_m
        hole = (left + 0.72, end - 0.72, low + 0.75, high - 0.55)
        self._hole(parts[wall], (left, end, low, high), hole, 0.22)
        a, b, c, d = hole
        self.panel(parts[self.lit.get(key, "glass")], (a, b), (c, d), -0.22)
        middle, bar = (a + b) / 2, c + 0.68 * (d - c)
        self.ledge(parts["trim"], (middle - 0.045, middle + 0.045), (c, d), (-0.22, -0.15))
        self.ledge(parts["trim"], (a, b), (bar - 0.04, bar + 0.04), (-0.22, -0.15))
        self.ledge(parts["trim"], (a - 0.12, b + 0.12), (c - 0.12, c), (0, 0.14))
        self.ledge(parts["trim"], (a - 0.12, b + 0.12), (d, d + 0.14), (0, 0.08))

    def _hole(self, mesh: Mesh, outer: Vector, hole: Vector, depth: float) -> None:
        """A piece of wall with a hole, and the four sides of the hole."""
        left, end, low, high = outer
        a, b, c, d = hole
        self.panel(mesh, (left, a), (low, high), 0)
        self.panel(mesh, (b, end), (low, high), 0)
        self.panel(mesh, (a, b), (low, c), 0)
        self.panel(mesh, (a, b), (d, high), 0)
        corners = [(a, c), (b, c), (b, d), (a, d)]
        for (r, u), (s, v) in zip(corners, corners[1:] + corners[:1], strict=True):
            mesh.quad(
                self.place(r, u, 0),
                self.place(s, v, 0),
                self.place(s, v, -depth),
                self.place(r, u, -depth),
            )

    def _ground_floor(self, parts: dict[str, Mesh], wall: str) -> None:
        """Dark windows, and a door in every third column."""
        for column in range(self.columns):
            left = column * self.column_m
            end = left + self.column_m
            door = column % 3 == 1
            hole = (left + 0.75, end - 0.75, 0.02 if door else 1.2, 2.7 if door else 3.1)
            self._hole(parts[wall], (left, end, 0, self.ground_m), hole, 0.3)
            a, b, c, d = hole
            self.panel(parts["door" if door else "glass"], (a, b), (c, d), -0.3)
            if not door:
                self.ledge(parts["trim"], (a - 0.1, b + 0.1), (c - 0.12, c), (0, 0.12))

    def _shop(self, parts: dict[str, Mesh], wall: str) -> None:
        """A glazed front of the whole width: a bright wall inside, and what stands before it."""
        width = self.width_m
        hole = (0.5, width - 0.5, 0.45, 3.0)
        self._hole(parts[wall], (0, width, 0, self.ground_m), hole, 1.6)
        a, b, c, d = hole
        self.panel(parts[self.shop], (a, b), (c, d), -1.6)
        count = round((b - a) / 2.1)
        for k in range(count + 1):
            at = a + (b - a) * k / count
            self.ledge(parts["door"], (at - 0.06, at + 0.06), (c, d), (-0.1, 0.02))
        self.ledge(parts["door"], (a, b), (2.35, 2.43), (-0.08, 0))
        self.ledge(parts["door"], (a, b), (c + 0.95, c + 1.0), (-1.5, -1.25))
        self._things_in_the_shop(parts["door"], hole)
        self.awning(parts["awning"], (a, b), 3.05)

    def _things_in_the_shop(self, mesh: Mesh, hole: Vector) -> None:
        """Bottles on a shelf and people at tables, as dark shapes."""
        a, b, low, _ = hole
        chance = np.random.default_rng(5)
        at = a + 0.2
        while at < b - 0.3:
            height, width = chance.uniform(0.15, 0.42), chance.uniform(0.06, 0.2)
            self.ledge(mesh, (at, at + width), (low + 1.0, low + 1.0 + height), (-1.45, -1.3))
            at += width + chance.uniform(0.03, 0.3)
        for at in np.arange(a + 0.8, b - 0.8, 2.3):
            self.ledge(mesh, (at, at + 0.42), (low, low + 0.75), (-0.9, -0.6))
            mesh.ball(self.place(at + 0.21, low + 0.93, -0.75), (0.1, 0.13, 0.1), 8)

    def awning(self, mesh: Mesh, right: Vector, up: float) -> None:
        """A sloping cloth above a shop."""
        a, b = right
        corners = [
            (a, up - 0.45, 1.3),
            (b, up - 0.45, 1.3),
            (b, up + 0.25, 0.02),
            (a, up + 0.25, 0.02),
        ]
        mesh.quad(*(self.place(*corner) for corner in corners))
        self.panel(mesh, (a, b), (up - 0.65, up - 0.45), 1.3)


def roof(facade: Facade, depth_m: float, mesh: Mesh) -> None:
    """A roof that rises away from the street, with chimneys."""
    width, height = facade.width_m, facade.height_m
    ridge = height + 2.6
    mesh.quad(*(facade.place(*p) for p in (
        (0, height, 0), (width, height, 0), (width, ridge, -depth_m / 2), (0, ridge, -depth_m / 2))))  # fmt: skip
    for r in (0.0, width):
        mesh.add(
            np.array([facade.place(r, 0, 0), facade.place(r, 0, -depth_m), facade.place(r, height, -depth_m),
                      facade.place(r, ridge, -depth_m / 2), facade.place(r, height, 0)]),
            np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]]),
        )  # fmt: skip
    for r in (0.25 * width, 0.72 * width):
        facade.ledge(
            mesh, (r, r + 0.9), (height + 0.8, ridge + 1.0), (-depth_m / 2, -depth_m / 2 + 0.6)
        )


# --- the car --------------------------------------------------------------------------------

WHEEL_RADIUS_M = 0.33
AXLES_Z_M = (1.32, -1.30)
TRACK_X_M = 0.80

# Along the car: z, half width, height of the underside, height of the shoulder.
BODY = (
    (2.13, 0.58, 0.36, 0.58), (2.10, 0.70, 0.28, 0.66), (2.00, 0.79, 0.22, 0.74), (1.75, 0.855, 0.20, 0.83),
    (1.30, 0.88, 0.20, 0.91), (0.80, 0.89, 0.20, 0.96), (0.00, 0.89, 0.20, 0.98), (-0.80, 0.89, 0.20, 1.00),
    (-1.40, 0.88, 0.21, 1.01), (-1.85, 0.85, 0.25, 1.00), (-2.08, 0.78, 0.30, 0.95), (-2.14, 0.66, 0.40, 0.86),
)  # fmt: skip

# The cabin: z at the shoulder and at the roof, half widths there, height of the roof.
CABIN_LOW, CABIN_HIGH = (1.05, -1.85), (0.18, -1.25)
CABIN_HALF_WIDTHS, ROOF_M = (0.81, 0.66), 1.46


def car_body() -> Mesh:
    """The painted body of a hatchback that looks along +z, with the roof and the posts of its cabin."""
    mesh = Mesh()
    rings = []
    for z, half, low, high in BODY[::-1]:
        ring = rounded_rectangle(half, (high - low) / 2, 4.5, 28)
        rings.append(
            np.column_stack([ring[:, 0], ring[:, 1] + (low + high) / 2, np.full(28, z)])
        )
    mesh.loft(rings)
    rows = []
    for share, lift in ((0.0, -0.05), (0.12, 0.0), (0.5, 0.035), (0.88, 0.0), (1.0, -0.06)):
        z = CABIN_HIGH[1] - 0.06 + share * (CABIN_HIGH[0] - CABIN_HIGH[1] + 0.12)
        ring = rounded_rectangle(CABIN_HALF_WIDTHS[1] + 0.03, 0.045, 3.0, 16)
        rows.append(
            np.column_stack([ring[:, 0], ring[:, 1] + ROOF_M - 0.03 + lift, np.full(16, z)])
        )
    mesh.loft(rows)
    for side in (-1, 1):
        for low_z, high_z in (
            (CABIN_LOW[0], CABIN_HIGH[0]),
            (-0.35, -0.4),
            (CABIN_LOW[1], CABIN_HIGH[1]),
        ):
            post = [
                (side * CABIN_HALF_WIDTHS[0], 0.94, low_z),
                (side * CABIN_HALF_WIDTHS[1], ROOF_M - 0.02, high_z),
            ]
            mesh.tube(post, (0.045, 0.035), 6)
        mesh.ball((side * 0.97, 1.03, 0.72), (0.11, 0.075, 0.06), 6)
    return mesh


def car_glass() -> Mesh:
    """The windows of the cabin, as one dark solid."""
    mesh = Mesh()
    (front, back), (roof_front, roof_back) = CABIN_LOW, CABIN_HIGH
    low, high = CABIN_HALF_WIDTHS
    bottom = np.array(
        [(-low, 0.93, back), (low, 0.93, back), (low, 0.93, front), (-low, 0.93, front)]
    )
    top = np.array([(-high, ROOF_M - 0.03, roof_back), (high, ROOF_M - 0.03, roof_back),
                    (high, ROOF_M - 0.03, roof_front), (-high, ROOF_M - 0.03, roof_front)])  # fmt: skip
    mesh.loft([bottom, top])
    return mesh


def car_dark_parts() -> Mesh:
    """Wheel arches, grille and lower air intake."""
    mesh = Mesh()
    for z in AXLES_Z_M:
        for side in (-1, 1):
            disc = circle(24) * 0.39
            inner, outer = side * 0.70, side * 0.893
            rings = [
                np.column_stack([np.full(24, x), disc[:, 1] + WHEEL_RADIUS_M, disc[:, 0] + z])
                for x in (inner, outer)
            ]
            mesh.loft(rings)
    mesh.box((-0.42, 0.52, 2.08), (0.42, 0.66, 2.15))
    mesh.box((-0.6, 0.26, 2.02), (0.6, 0.40, 2.13))
    return mesh


def tyre() -> Mesh:
    """A tyre about the x axis, its centre at the origin."""
    mesh = Mesh()
    profile = (
        (-0.10, 0.20),
        (-0.115, 0.27),
        (-0.10, WHEEL_RADIUS_M),
        (0.10, WHEEL_RADIUS_M),
        (0.115, 0.27),
        (0.10, 0.20),
    )
    rings = []
    for x, radius in profile:
        disc = circle(32) * radius
        rings.append(np.column_stack([np.full(32, x), disc]))
    mesh.loft(rings)
    return mesh


def rim() -> Mesh:
    """Five spokes and a ring of a wheel, on both of its sides."""
    mesh = Mesh()
    for side in (-1, 1):
        x = side * 0.118
        for k in range(5):
            angle = 2 * np.pi * k / 5
            along, across = (
                np.array([np.cos(angle), np.sin(angle)]),
                np.array([-np.sin(angle), np.cos(angle)]),
            )
            corners = [0.03 * along + w * across for w in (-0.05, 0.05)] + [
                0.235 * along + w * across for w in (0.03, -0.03)
            ]
            mesh.quad(*((x, *corner) for corner in corners))
        ring = circle(24)
        for k in range(24):
            a, b = ring[k], ring[(k + 1) % 24]
            mesh.quad((x, *(0.215 * a)), (x, *(0.25 * a)), (x, *(0.25 * b)), (x, *(0.215 * b)))
    return mesh


# --- a person with an umbrella --------------------------------------------------------------


def coat() -> Mesh:
    """A long coat, arms and a hat, of a person who walks along +x."""
    mesh = Mesh()
    stations = (  # height, half depth (x), half width (z), forward lean
        (0.52, 0.25, 0.22, -0.02), (0.70, 0.22, 0.21, -0.01), (0.95, 0.175, 0.20, 0.0), (1.10, 0.15, 0.185, 0.01),
        (1.28, 0.16, 0.21, 0.02), (1.42, 0.135, 0.205, 0.025), (1.50, 0.08, 0.10, 0.03), (1.55, 0.06, 0.065, 0.035),
    )  # fmt: skip
    rings = []
    for height, deep, wide, lean in stations:
        ring = circle(20)
        rings.append(
            np.column_stack([lean + deep * ring[:, 1], np.full(20, height), wide * ring[:, 0]])
        )
    mesh.loft(rings)
    mesh.tube(
        [(0.02, 1.42, 0.20), (0.02, 1.16, 0.27), (0.16, 1.02, 0.24), (0.24, 1.20, 0.2)],
        (0.062, 0.058, 0.05, 0.042),
    )
    mesh.tube(
        [(0.02, 1.42, -0.20), (-0.06, 1.15, -0.25), (-0.12, 0.92, -0.25), (-0.12, 0.85, -0.25)],
        (0.062, 0.056, 0.045, 0.04),
    )
    return mesh


def legs() -> Mesh:
    """Trousers and shoes in a stride."""
    mesh = Mesh()
    mesh.tube([(0.02, 0.85, 0.09), (0.16, 0.48, 0.09), (0.24, 0.08, 0.09)], (0.09, 0.068, 0.05))
    mesh.tube(
        [(-0.02, 0.85, -0.09), (-0.08, 0.48, -0.09), (-0.30, 0.14, -0.09)], (0.09, 0.068, 0.05)
    )
    mesh.ball((0.30, 0.045, 0.09), (0.14, 0.05, 0.05), 8)
    mesh.ball((-0.28, 0.09, -0.09), (0.12, 0.06, 0.05), 8)
    return mesh


def head() -> Mesh:
    """Head, neck and hands."""
    mesh = Mesh()
    mesh.ball((0.06, 1.675, 0), (0.095, 0.125, 0.08), 10)
    mesh.tube([(0.04, 1.5, 0), (0.05, 1.6, 0)], (0.055, 0.05))
    mesh.ball((0.25, 1.24, 0.2), (0.045, 0.05, 0.04), 6)
    mesh.ball((-0.11, 0.80, -0.25), (0.04, 0.06, 0.035), 6)
    return mesh


def umbrella() -> Mesh:
    """The cloth of an umbrella of eight ribs."""
    mesh = Mesh()
    ribs, steps = 8, 6
    rows = []
    for k in range(steps + 1):
        slope = 0.02 + 1.12 * k / steps
        around = 2 * np.pi * np.arange(4 * ribs) / (4 * ribs)
        hollow = 1 - 0.10 * (k / steps) ** 2 * np.abs(np.sin(ribs * around / 2))
        radius = 0.62 * np.sin(slope) / np.sin(1.14) * hollow
        height = 2.17 - 0.42 * (1 - np.cos(slope)) / (1 - np.cos(1.14)) * (2 - hollow)
        rows.append(
            np.column_stack(
                [0.2 + radius * np.cos(around), height, 0.14 + radius * np.sin(around)]
            )
        )
    count = 4 * ribs
    around, following = np.arange(count), (np.arange(count) + 1) % count
    faces = []
    for k in range(steps):
        low, high = k * count, (k + 1) * count
        faces.append(np.column_stack([low + around, high + around, high + following]))
        faces.append(np.column_stack([low + around, high + following, low + following]))
    mesh.add(np.concatenate(rows), np.concatenate(faces))
    return mesh


def umbrella_stick() -> Mesh:
    """The stick of the umbrella."""
    mesh = Mesh()
    mesh.tube([(0.25, 1.12, 0.2), (0.2, 2.25, 0.14)], (0.012, 0.012), 6)
    return mesh


# --- a tree ---------------------------------------------------------------------------------


def tree(seed: int) -> tuple[Mesh, Mesh]:
    """Trunk with branches, and leaves, of a young street tree."""
    chance = np.random.default_rng(seed)
    wood, leaves = Mesh(), Mesh()
    wood.tube(
        [(0, 0, 0), (0.03, 1.3, 0.02), (0, 2.6, 0), (0.05, 4.2, 0.05)],
        (0.11, 0.09, 0.075, 0.03),
    )
    crown = []
    for _ in range(13):
        angle, low = chance.uniform(0, 2 * np.pi), chance.uniform(1.9, 3.4)
        reach, rise = chance.uniform(0.7, 1.5), chance.uniform(0.7, 1.6)
        end = np.array([reach * np.cos(angle), low + rise, reach * np.sin(angle)])
        middle = np.array(
            [0.5 * reach * np.cos(angle), low + 0.35 * rise, 0.5 * reach * np.sin(angle)]
        )
        wood.tube([(0, low, 0), middle, end], (0.04, 0.03, 0.012), 5)
        crown += [0.6 * middle + 0.4 * end, end]
    crown += [np.array([0.05, 4.3, 0.05])]
    for centre in crown:
        for place in centre + chance.normal(0, 0.33, (26, 3)):
            first, second = np.linalg.qr(chance.normal(size=(3, 3)))[0][:2]
            a, b = 0.10 * first, 0.05 * second
            leaves.quad(place - a, place - b, place + a, place + b)
    return wood, leaves


# --- textures -------------------------------------------------------------------------------


def noise(size: int, seed: int, longest: float, slope: float) -> np.ndarray:
    """Random hills that repeat at the edges, mean 0, σ 1.  longest : wave in widths.  slope : of the amplitude."""
    chance = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None]) * size
    weight = np.where(frequency >= 1 / longest, np.maximum(frequency, 1) ** -slope, 0)
    hills = np.fft.ifft2(np.fft.fft2(chance.normal(size=(size, size))) * weight).real
    return (hills - hills.mean()) / hills.std()


def puddles(size: int = 512) -> np.ndarray:
    """Where water stands on the road: 1 in puddles, 0 on what is only wet, (size, size)."""
    hills = noise(size, 16, 0.25, 1.9)
    return np.clip((hills - 0.75) / 0.45, 0, 1)


def asphalt_relief(size: int = 256) -> np.ndarray:
    """Relative height of worn asphalt, 0 to 1, (size, size)."""
    hills = noise(size, 12, 0.5, 0.9)
    return np.clip(0.5 + hills / 6, 0, 1)


def evening_sky(width: int = 192, height: int = 96) -> np.ndarray:
    """Radiance of the sky late in the evening, relative, linear sRGB, (height, width, 3); the row of the zenith is 0.

    The glow stands where the street ends; the clouds take up the light of the town.
    """
    elevation = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    azimuth = 2 * np.pi * (np.arange(width) + 0.5) / width
    up = np.clip(np.sin(elevation), 0, 1)[:, None]
    towards = 0.5 + 0.5 * np.cos(azimuth)[None]
    zenith, horizon = np.array([0.022, 0.045, 0.110]), np.array([0.80, 0.36, 0.13])
    share = np.exp(-up / 0.16)[..., None]
    glow = (0.35 + 0.65 * towards**2)[..., None]
    sky = zenith * (1 + 0.8 * np.exp(-up / 0.5)[..., None]) + horizon * share * glow
    clouds = np.clip(noise(256, 21, 0.4, 1.6)[:height, :width] - 0.1, 0, 2)[..., None]
    sky += clouds * np.exp(-up / 0.35)[..., None] * np.array([0.06, 0.045, 0.05])
    return np.where(elevation[:, None, None] > -0.02, sky, 0.02 * horizon)
