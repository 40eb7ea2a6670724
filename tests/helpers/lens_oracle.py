"""A ray tracer that shares nothing with the package: vectors, quadratic equations, from the raw table of a lens.

The double Gauss is written down again here, for 50 mm, so that a slip in the shipped file is seen too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Radius (0: the stop), thickness, index behind, clear diameter [mm]; US patent 2,673,491 after Smith 1992, p. 312.
DOUBLE_GAUSS = (
    (29.475, 3.76, 1.67, 25.2),
    (84.83, 0.12, 1.0, 25.2),
    (19.275, 4.025, 1.67, 23.0),
    (40.77, 3.275, 1.699, 23.0),
    (12.75, 5.705, 1.0, 18.0),
    (0.0, 4.5, 1.0, 17.1),
    (-14.495, 1.18, 1.603, 17.0),
    (40.77, 6.065, 1.658, 20.0),
    (-20.385, 0.19, 1.0, 20.0),
    (437.065, 3.22, 1.717, 20.0),
    (-39.73, 0.0, 1.0, 20.0),
)
# E/L on its axis [sr] by f-number: π·sin²u′ of the ray through the edge of the stop to the paraxial focus, traced by
# Optiland 0.6.3 with the entrance pupil f/N (``imageFNO``). π/(4N²) is 0.1001783 and 0.0250446.
AXIAL_IRRADIANCE = {2.8: 0.1011344, 5.6: 0.0250889}
Table = tuple[tuple[float, float, float, float], ...]
Array = NDArray[np.float64]


def vertices(table: Table) -> Array:
    """z of every surface, light running towards +z, the first at 0."""
    return np.concatenate([[0.0], np.cumsum([row[1] for row in table])[:-1]])


def forward(
    table: Table, p: Array, d: Array, stop: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Rays from the scene through all surfaces: points and directions, (n, 3), after the last, and which got there."""
    steps = [
        (row, z, before)
        for row, z, before in zip(table, vertices(table), behind(table)[:-1], strict=True)
    ]
    return _through([(row, z, n, row[2]) for row, z, n in steps], p, d, stop)


def backward(
    table: Table, p: Array, d: Array, stop: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The same from the sensor: directions with negative z."""
    steps = list(zip(table, vertices(table), behind(table)[:-1], strict=True))
    return _through([(row, z, row[2], n) for row, z, n in reversed(steps)], p, d, stop)


def behind(table: Table) -> list[float]:
    """Index before each surface, and behind the last."""
    return [1.0, *(row[2] for row in table)]


def _through(
    steps: list, p: Array, d: Array, stop: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    unvignetted, index = np.ones(len(p), bool), np.arange(len(p))
    points, ways = p.copy(), d.copy()
    for (radius, _, _, diameter), z, before, after in steps:
        p, d = points[index], ways[index]
        if radius == 0:
            p = p + ((z - p[:, 2]) / d[:, 2])[:, None] * d
            good = np.hypot(p[:, 0], p[:, 1]) <= stop
        else:
            p, normal, good = _sphere(p, d, z, radius)
            good &= np.hypot(p[:, 0], p[:, 1]) <= diameter / 2
            d, refracted = _snell(d, normal, before / after)
            good &= refracted
        unvignetted[index[~good]] = False
        index = index[good]
        points[index], ways[index] = p[good], d[good]
    return points, ways, unvignetted


def _sphere(
    p: Array, d: Array, z: float, radius: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Where rays meet a sphere on the side of its vertex."""
    centre = np.array([0.0, 0.0, z + radius])
    q = p - centre
    half, rest = (q * d).sum(axis=1), (q * q).sum(axis=1) - radius**2
    root = half**2 - rest
    good = root > 0
    t = -half + np.sign(-radius * d[:, 2]) * np.sqrt(np.where(good, root, 0.0))
    at = p + t[:, None] * d
    return at, (at - centre) / radius, good


def _snell(d: Array, normal: Array, ratio: float) -> tuple[Array, NDArray[np.bool_]]:
    normal = np.where((d * normal).sum(axis=1, keepdims=True) < 0, normal, -normal)
    cosine = -(d * normal).sum(axis=1)
    square = 1 - ratio**2 * (1 - cosine**2)
    good = square > 0
    return ratio * d + (ratio * cosine - np.sqrt(np.where(good, square, 0.0)))[
        :, None
    ] * normal, good


def irradiance(
    table: Table, pixel: tuple[Array, Array], distance: float, stop: float, rays: int
) -> tuple[float, float]:
    """E/L [sr] of a pixel by direct counting, and its standard error.

    pixel : its corners (x0, y0) and (x1, y1) [mm]. Points are drawn evenly over the pixel, and over a square over the
    whole back of the lens; what gets out at the front counts with cos⁴/Z².
    """
    random, half = np.random.default_rng(5), 0.55 * table[-1][3]
    rear = vertices(table)[-1]
    places = random.uniform(*pixel, (rays, 2))
    film = np.column_stack([places, np.full(rays, rear + distance)])
    back = np.column_stack([random.uniform(-half, half, (rays, 2)), np.full(rays, rear)])
    way = back - film
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    passed = backward(table, film, way, stop)[2]
    shares = (2 * half) ** 2 * way[:, 2] ** 4 / distance**2 * passed
    return float(shares.mean()), float(shares.std() / np.sqrt(rays))


def axial_irradiance(table: Table, distance: float, stop: float, rays: int = 60_001) -> float:
    """E/L [sr] on the axis, ``distance`` behind the last vertex: π·sin²u′ of the widest cone that passes."""
    sine = np.linspace(0.08, 0.2, rays)
    film = np.tile([0.0, 0.0, vertices(table)[-1] + distance], (rays, 1))
    passed = backward(
        table, film, np.column_stack([sine, 0 * sine, -np.sqrt(1 - sine**2)]), stop
    )[2]
    return float(np.pi * sine[np.argmin(passed) - 1] ** 2)
