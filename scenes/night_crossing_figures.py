"""The car, the person and the trees of night_crossing.xml; the car looks along +z, the person walks along +x."""

from __future__ import annotations

import numpy as np
from night_crossing_mesh import Mesh, circle, superellipse

WHEEL_RADIUS_M, AXLES_Z_M, TRACK_X_M = 0.33, (1.32, -1.30), 0.80

# Along the car: z, half its width, height of the underside, height of the shoulder.
BODY_M = (
    (-2.14, 0.66, 0.40, 0.86), (-2.08, 0.78, 0.30, 0.95), (-1.85, 0.85, 0.25, 1.00),
    (-1.40, 0.88, 0.21, 1.01), (-0.80, 0.89, 0.20, 1.00), (0.00, 0.89, 0.20, 0.98),
    (0.80, 0.89, 0.20, 0.96), (1.30, 0.88, 0.20, 0.91), (1.75, 0.855, 0.20, 0.83),
    (2.00, 0.79, 0.22, 0.74), (2.10, 0.70, 0.28, 0.66), (2.13, 0.58, 0.36, 0.58),
)  # fmt: skip
SHOULDER_Z_M, ROOF_Z_M = (1.05, -1.85), (0.18, -1.25)  # front and back of the cabin
SHOULDER_HALF_M, ROOF_HALF_M, SHOULDER_M, ROOF_M = 0.81, 0.66, 0.93, 1.46
TYRE_M = (  # x and radius
    (-0.10, 0.20), (-0.115, 0.27), (-0.10, WHEEL_RADIUS_M), (0.10, WHEEL_RADIUS_M), (0.115, 0.27), (0.10, 0.20),
)  # fmt: skip
SPOKES = 5

# Up a coat: height, half its depth (x), half its width (z), how far it leans forward.
COAT_M = (
    (0.52, 0.25, 0.22, -0.02), (0.70, 0.22, 0.21, -0.01), (0.95, 0.175, 0.20, 0.0),
    (1.10, 0.15, 0.185, 0.01), (1.28, 0.16, 0.21, 0.02), (1.42, 0.135, 0.205, 0.025),
    (1.50, 0.08, 0.10, 0.03), (1.55, 0.06, 0.065, 0.035),
)  # fmt: skip
RIBS, UMBRELLA_ROWS, UMBRELLA_ANGLE = 8, 6, 1.14


def car_body() -> Mesh:
    """The painted body of a hatchback, with the roof, the posts and the mirrors of its cabin."""
    mesh = Mesh()
    rings = []
    for z, half, low, high in BODY_M:
        ring = superellipse(half, (high - low) / 2, 4.5, 28)
        rings.append(np.column_stack([np.add(ring, (0, (low + high) / 2)), np.full(28, z)]))
    mesh.loft(rings)
    rings = []
    for share, lift in ((0.0, -0.05), (0.12, 0.0), (0.5, 0.035), (0.88, 0.0), (1.0, -0.06)):
        z = ROOF_Z_M[1] - 0.06 + share * (ROOF_Z_M[0] - ROOF_Z_M[1] + 0.12)
        ring = superellipse(ROOF_HALF_M + 0.03, 0.045, 3.0, 16)
        rings.append(np.column_stack([np.add(ring, (0, ROOF_M - 0.03 + lift)), np.full(16, z)]))
    mesh.loft(rings)
    posts = [(SHOULDER_Z_M[0], ROOF_Z_M[0]), (-0.35, -0.4), (SHOULDER_Z_M[1], ROOF_Z_M[1])]
    for side in (-1, 1):
        for low_z, high_z in posts:
            foot = side * SHOULDER_HALF_M, SHOULDER_M + 0.01, low_z
            mesh.tube([foot, (side * ROOF_HALF_M, ROOF_M - 0.02, high_z)], (0.045, 0.035), 6)
        mesh.ball((side * 0.97, 1.03, 0.72), (0.11, 0.075, 0.06), 6)
    return mesh


def car_glass() -> Mesh:
    """The windows of the cabin, as one dark solid."""
    rings = []
    for half, y, (front, back) in (
        (SHOULDER_HALF_M, SHOULDER_M, SHOULDER_Z_M),
        (ROOF_HALF_M, ROOF_M - 0.03, ROOF_Z_M),
    ):
        corners = [(-half, y, back), (-half, y, front), (half, y, front), (half, y, back)]
        rings.append(np.array(corners))
    mesh = Mesh()
    mesh.loft(rings)
    return mesh


def car_dark_parts() -> Mesh:
    """Wheel arches, grille and lower air intake."""
    mesh = Mesh()
    arch = 0.39 * circle(24)
    for z in AXLES_Z_M:
        for side in (-1, 1):
            rings = []
            for x in (side * 0.70, side * 0.893):
                rings.append(
                    np.column_stack([np.full(24, x), np.add(arch, (WHEEL_RADIUS_M, z))])
                )
            mesh.loft(rings)
    mesh.box((-0.42, 0.52, 2.08), (0.42, 0.66, 2.15))
    mesh.box((-0.6, 0.26, 2.02), (0.6, 0.40, 2.13))
    return mesh


def tyre() -> Mesh:
    """A tyre about the x axis, its centre at the origin."""
    mesh = Mesh()
    mesh.loft([np.column_stack([np.full(32, x), radius * circle(32)]) for x, radius in TYRE_M])
    return mesh


def rim() -> Mesh:
    """Spokes and a ring of a wheel, on both of its sides."""
    mesh = Mesh()
    for x in (-0.118, 0.118):
        for along in circle(SPOKES):
            across = np.array([-along[1], along[0]])
            inner = [0.03 * along + w * across for w in (-0.05, 0.05)]
            outer = [0.235 * along + w * across for w in (0.03, -0.03)]
            mesh.quad(*((x, *corner) for corner in inner + outer))
        mesh.skin([np.column_stack([np.full(24, x), r * circle(24)]) for r in (0.215, 0.25)])
    return mesh


def coat() -> Mesh:
    """A long coat with its arms."""
    mesh = Mesh()
    rings = []
    for height, deep, wide, lean in COAT_M:
        x, z = (circle(20)[:, ::-1] * (deep, wide) + (lean, 0)).T
        rings.append(np.column_stack([x, np.full(20, height), z]))
    mesh.loft(rings)
    raised = [(0.02, 1.42, 0.20), (0.02, 1.16, 0.27), (0.16, 1.02, 0.24), (0.24, 1.20, 0.2)]
    mesh.tube(raised, (0.062, 0.058, 0.05, 0.042))
    hanging = [(0.02, 1.42, -0.20), (-0.06, 1.15, -0.25), (-0.12, 0.92, -0.25), (-0.12, 0.85, -0.25)]  # fmt: skip
    mesh.tube(hanging, (0.062, 0.056, 0.045, 0.04))
    return mesh


def legs() -> Mesh:
    """Trousers and shoes in a stride."""
    mesh, radii = Mesh(), (0.09, 0.068, 0.05)
    mesh.tube([(0.02, 0.85, 0.09), (0.16, 0.48, 0.09), (0.24, 0.08, 0.09)], radii)
    mesh.tube([(-0.02, 0.85, -0.09), (-0.08, 0.48, -0.09), (-0.30, 0.14, -0.09)], radii)
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
    """The cloth of an umbrella, which hangs a little between its ribs."""
    count = 4 * RIBS
    flat = circle(count)
    between = np.abs(np.sin(np.pi * RIBS * np.arange(count) / count))
    rings = []
    for share in np.linspace(0, 1, UMBRELLA_ROWS + 1):
        slope = 0.02 + (UMBRELLA_ANGLE - 0.02) * share
        hollow = 1 - 0.10 * share**2 * between
        radius = 0.62 * np.sin(slope) / np.sin(UMBRELLA_ANGLE) * hollow
        drop = 0.42 * (1 - np.cos(slope)) / (1 - np.cos(UMBRELLA_ANGLE)) * (2 - hollow)
        x, z = (radius[:, None] * flat + (0.2, 0.14)).T
        rings.append(np.column_stack([x, 2.17 - drop, z]))
    mesh = Mesh()
    mesh.skin(rings)
    return mesh


def umbrella_stick() -> Mesh:
    mesh = Mesh()
    mesh.tube([(0.25, 1.12, 0.2), (0.2, 2.25, 0.14)], (0.012, 0.012), 6)
    return mesh


def tree(seed: int) -> tuple[Mesh, Mesh]:
    """Trunk with branches, and leaves, of a young street tree."""
    chance = np.random.default_rng(seed)
    wood, leaves = Mesh(), Mesh()
    trunk = [(0, 0, 0), (0.03, 1.3, 0.02), (0, 2.6, 0), (0.05, 4.2, 0.05)]
    wood.tube(trunk, (0.11, 0.09, 0.075, 0.03))
    tufts = [np.array([0.05, 4.3, 0.05])]
    for _ in range(13):
        angle, low = chance.uniform(0, 2 * np.pi), chance.uniform(1.9, 3.4)
        reach, rise = chance.uniform(0.7, 1.5), chance.uniform(0.7, 1.6)
        outwards = np.array([np.cos(angle), 0, np.sin(angle)])
        end = reach * outwards + (0, low + rise, 0)
        middle = 0.5 * reach * outwards + (0, low + 0.35 * rise, 0)
        wood.tube([(0, low, 0), middle, end], (0.04, 0.03, 0.012), 5)
        tufts += [0.6 * middle + 0.4 * end, end]
    for tuft in tufts:
        for place in tuft + chance.normal(0, 0.33, (26, 3)):
            first, second = chance.normal(size=(2, 3))
            a = 0.10 * first / np.linalg.norm(first)
            b = 0.05 * np.cross(a, second) / np.linalg.norm(np.cross(a, second))
            leaves.quad(place - a, place - b, place + a, place + b)
    return wood, leaves
