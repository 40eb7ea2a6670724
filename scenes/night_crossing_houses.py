"""The houses of night_crossing.xml: walls with windows, ledges, shop fronts and roofs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from night_crossing_mesh import Mesh, Vector

COLUMN_M, GROUND_M, FLOOR_M, PARAPET_M = 2.7, 4.2, 3.3, 0.6
RECESS_M, DOOR_RECESS_M, SHOP_DEPTH_M = 0.22, 0.3, 1.6
ROOF_DEPTH_M, RIDGE_M = 9.0, 2.6
SHELF_SEED = 5

Parts = Mapping[str, Mesh]
Corner = tuple[float, float]


@dataclass(frozen=True)
class Facade:
    """A wall with rows of windows.

    origin : its lower left corner, as seen from the street.  along : direction to the right.
    lit : the mesh that the pane at (floor, column) belongs to; "glass" where there is none.
    shop : the mesh that the bright wall of a shop belongs to, if there is one.
    """

    origin: Vector
    along: Vector
    columns: int
    floors: int
    lit: Mapping[tuple[int, int], str]
    shop: str = ""

    @property
    def width_m(self) -> float:
        return self.columns * COLUMN_M

    @property
    def height_m(self) -> float:
        return GROUND_M + self.floors * FLOOR_M + PARAPET_M

    def place(self, right: float, up: float, out: float) -> np.ndarray:
        """World point of a place on the wall; out is towards the street."""
        direction = np.asarray(self.along, float)
        outwards = np.cross(direction, (0, 1, 0))
        return np.asarray(self.origin, float) + right * direction + (0, up, 0) + out * outwards

    def panel(self, mesh: Mesh, right: Corner, up: Corner, out: float) -> None:
        """A flat rectangle parallel to the wall that faces the street."""
        (left, end), (low, high) = right, up
        corners = [(left, low), (end, low), (end, high), (left, high)]
        mesh.quad(*(self.place(r, u, out) for r, u in corners))

    def ledge(self, mesh: Mesh, right: Corner, up: Corner, out: Corner) -> None:
        """A beam that lies along the wall: front, top and underside, both ends."""
        (left, end), (low, high), (back, front) = right, up, out
        self.panel(mesh, right, up, front)
        sides = [
            [(left, high, front), (end, high, front), (end, high, back), (left, high, back)],
            [(left, low, back), (end, low, back), (end, low, front), (left, low, front)],
            [(left, low, back), (left, low, front), (left, high, front), (left, high, back)],
            [(end, low, front), (end, low, back), (end, high, back), (end, high, front)],
        ]
        for corners in sides:
            mesh.quad(*(self.place(*corner) for corner in corners))

    def build(self, parts: Parts, wall: str) -> None:
        """Add the wall, its windows, ledges and roof to these meshes.  wall : the name of its own."""
        for floor in range(self.floors):
            for column in range(self.columns):
                self._window(parts, wall, floor, column)
        top, trim, width = self.height_m - PARAPET_M, parts["trim"], self.width_m
        self.panel(parts[wall], (0, width), (top, self.height_m), 0)
        self.ledge(trim, (-0.15, width + 0.15), (top + 0.25, top + 0.6), (-0.3, 0.4))
        self.ledge(trim, (0, width), (GROUND_M - 0.35, GROUND_M - 0.1), (0, 0.16))
        self._roof(parts["roofs"])
        if self.shop:
            self._shop(parts, wall)
            return
        for column in range(self.columns):
            self._ground_floor(parts, wall, column)

    def _window(self, parts: Parts, wall: str, floor: int, column: int) -> None:
        """A window in its piece of wall: pane behind the wall, bars, sill and lintel."""
        left, low = column * COLUMN_M, GROUND_M + floor * FLOOR_M
        end, high = left + COLUMN_M, low + FLOOR_M
        a, b, c, d = left + 0.72, end - 0.72, low + 0.75, high - 0.55
        self._hole(parts[wall], (left, end, low, high), (a, b, c, d), RECESS_M)
        self.panel(parts[self.lit.get((floor, column), "glass")], (a, b), (c, d), -RECESS_M)
        middle, bar, depth = (a + b) / 2, c + 0.68 * (d - c), (-RECESS_M, -0.15)
        trim = parts["trim"]
        self.ledge(trim, (middle - 0.045, middle + 0.045), (c, d), depth)
        self.ledge(trim, (a, b), (bar - 0.04, bar + 0.04), depth)
        self.ledge(trim, (a - 0.12, b + 0.12), (c - 0.12, c), (0, 0.14))
        self.ledge(trim, (a - 0.12, b + 0.12), (d, d + 0.14), (0, 0.08))

    def _hole(self, mesh: Mesh, outer: Vector, hole: Vector, depth: float) -> None:
        """A piece of wall with a hole, and the four sides of the hole."""
        left, end, low, high = outer
        a, b, c, d = hole
        self.panel(mesh, (left, a), (low, high), 0)
        self.panel(mesh, (b, end), (low, high), 0)
        self.panel(mesh, (a, b), (low, c), 0)
        self.panel(mesh, (a, b), (d, high), 0)
        corners = [(a, c), (b, c), (b, d), (a, d)]
        for here, there in zip(corners, corners[1:] + corners[:1], strict=True):
            front = self.place(*here, 0), self.place(*there, 0)
            back = self.place(*there, -depth), self.place(*here, -depth)
            mesh.quad(*front, *back)

    def _ground_floor(self, parts: Parts, wall: str, column: int) -> None:
        """A dark window, or a door in every third column."""
        left, end = column * COLUMN_M, (column + 1) * COLUMN_M
        is_door = column % 3 == 1
        low, high, pane = 1.2, 3.1, "glass"
        if is_door:
            low, high, pane = 0.02, 2.7, "door"
        a, b = left + 0.75, end - 0.75
        self._hole(parts[wall], (left, end, 0, GROUND_M), (a, b, low, high), DOOR_RECESS_M)
        self.panel(parts[pane], (a, b), (low, high), -DOOR_RECESS_M)
        if not is_door:
            self.ledge(parts["trim"], (a - 0.1, b + 0.1), (low - 0.12, low), (0, 0.12))

    def _shop(self, parts: Parts, wall: str) -> None:
        """An open front of the whole width: a bright wall inside, and what stands before it."""
        a, b, low, high = 0.5, self.width_m - 0.5, 0.45, 3.0
        outer = (0, self.width_m, 0, GROUND_M)
        self._hole(parts[wall], outer, (a, b, low, high), SHOP_DEPTH_M)
        self.panel(parts[self.shop], (a, b), (low, high), -SHOP_DEPTH_M)
        dark = parts["door"]
        posts = np.linspace(a, b, round((b - a) / 2.1) + 1)
        for at in posts:
            self.ledge(dark, (at - 0.06, at + 0.06), (low, high), (-0.1, 0.02))
        self.ledge(dark, (a, b), (2.35, 2.43), (-0.08, 0))
        self.ledge(dark, (a, b), (low + 0.95, low + 1.0), (-1.5, -1.25))
        self._things_in_the_shop(dark, (a, b), low)
        self._awning(parts["awning"], (a, b), 3.05)

    def _things_in_the_shop(self, mesh: Mesh, right: Corner, low: float) -> None:
        """Bottles on a shelf, tables and people, as dark shapes."""
        chance = np.random.default_rng(SHELF_SEED)
        shelf = low + 1.0
        at = right[0] + 0.2
        while at < right[1] - 0.3:
            height, width = chance.uniform(0.15, 0.42), chance.uniform(0.06, 0.2)
            self.ledge(mesh, (at, at + width), (shelf, shelf + height), (-1.45, -1.3))
            at += width + chance.uniform(0.03, 0.3)
        for at in np.arange(right[0] + 0.8, right[1] - 0.8, 2.3):
            self.ledge(mesh, (at, at + 0.42), (low, low + 0.75), (-0.9, -0.6))
            mesh.ball(self.place(at + 0.21, low + 0.93, -0.75), (0.1, 0.13, 0.1), 8)

    def _awning(self, mesh: Mesh, right: Corner, up: float) -> None:
        """A sloping cloth above the shop, with a hem."""
        a, b = right
        low, high, reach = up - 0.45, up + 0.25, 1.3
        corners = [(a, low, reach), (b, low, reach), (b, high, 0.02), (a, high, 0.02)]
        mesh.quad(*(self.place(*corner) for corner in corners))
        self.panel(mesh, right, (low - 0.2, low), reach)

    def _roof(self, mesh: Mesh) -> None:
        """A roof that rises away from the street, gables and two chimneys."""
        width, height, back = self.width_m, self.height_m, -ROOF_DEPTH_M / 2
        ridge = height + RIDGE_M
        slope = [(0, height, 0), (width, height, 0), (width, ridge, back), (0, ridge, back)]
        mesh.quad(*(self.place(*corner) for corner in slope))
        for r in (0.0, width):
            gable = [(0, 0), (0, 2 * back), (height, 2 * back), (ridge, back), (height, 0)]
            points = np.array([self.place(r, up, out) for up, out in gable])
            mesh.add(points, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]]))
        for r in (0.25 * width, 0.72 * width):
            self.ledge(mesh, (r, r + 0.9), (height + 0.8, ridge + 1.0), (back, back + 0.6))
