"""Ray-transfer functions of our own making, in ISET's format: polynomials fitted to rays of a lens that is known."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mitsuba_sensor.camera.lens_datasheet import LensSection
from mitsuba_sensor.optics.ray_trace import Ray, ray_to
from mitsuba_sensor.optics.traced_lens import TracedLens, cardinal_points, traced_lens

Numbers = NDArray[np.float64]
OUTPUTS = ("x", "y", "dx", "dy")


def fitted_polynomials(
    inputs: Numbers, outputs: Numbers, degree: int
) -> tuple[list[dict[str, Any]], Numbers]:
    """ISET's ``poly`` by least squares, and the largest residual of each output.

    Odd in the whole by rotation, x and dx odd in dx by reflection.
    inputs : r, dx, dy of each ray, (n, 3).  outputs : x, y, dx, dy, (n, 4).
    """
    polynomials, residuals = [], []
    scale = np.abs(inputs).max(axis=0)
    for name, values in zip(OUTPUTS, outputs.T, strict=True):
        powers = np.array([p for p in product(range(degree + 1), repeat=3) if sum(p) <= degree])
        powers = powers[powers.sum(axis=1) % 2 == 1]
        powers = powers[powers[:, 1] % 2 == int(name in ("x", "dx"))]
        basis = np.prod((inputs / scale)[:, None, :] ** powers, axis=2)
        found, *_ = np.linalg.lstsq(basis, values, rcond=1e-13)
        residuals.append(np.abs(basis @ found - values).max())
        polynomial = {
            "outputname": f"out{name}",
            "coeff": (found / np.prod(scale**powers, axis=1)).tolist(),
        }
        for column, term in enumerate(("termr", "termdx", "termdy")):
            polynomial[term] = powers[:, column].tolist()
        polynomials.append(polynomial)
    return polynomials, np.array(residuals)


def iset_json(
    polynomials: list[dict[str, Any]], raypass: dict[str, Any], **planes: float
) -> dict[str, Any]:
    """planes : thickness, planeoffsetinput and planeoffsetoutput."""
    wavelength = {"wavelength_nm": 550, "raypass": raypass, "poly": polynomials}
    none = {"thickness": 0, "planeoffsetinput": 0, "planeoffsetoutput": 0}
    head = {"description": "", "name": "ours", "useDZpolynomial": False}
    return {**head, **none, **planes, "polynomials": [wavelength]}


def written(folder: Path, data: dict[str, Any], name: str = "ours") -> str:
    """The path of the file."""
    path = folder / f"{name}-raytransfer.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    return str(path)


def thin_lens(
    focal_mm: float, radius_mm: float, degree: int = 7, before_mm: float = 10.0
) -> Any:
    """The file of an ideal thin lens, whose input plane is before it; residuals of its directions are below 1e-6 up to
    a slope of 0.35."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-0.35, 0.35, (2, 4000))
    y_lens = rng.uniform(-radius_mm, radius_mm, u.size)
    x_lens = rng.uniform(-radius_mm, radius_mm, u.size)
    x_in, y_in = x_lens - before_mm * u, y_lens - before_mm * v
    r = np.hypot(x_in, y_in)
    ex, ey = np.stack([y_in, -x_in]) / r, np.stack([x_in, y_in]) / r
    points, slopes = np.stack([x_lens, y_lens]), np.stack([u, v])
    after = slopes - points / focal_mm

    def turned(values: Numbers) -> list[Numbers]:
        return [(values * ex).sum(axis=0), (values * ey).sum(axis=0)]

    def cosines(values: Numbers) -> Numbers:
        return values / np.sqrt(1 + (values**2).sum(axis=0))

    inputs = np.stack([r, *turned(cosines(slopes))], axis=1)
    outputs = np.stack([*turned(points), *turned(cosines(after))], axis=1)
    polynomials, residuals = fitted_polynomials(inputs, outputs, degree)
    raypass = {
        "method": "circles",
        "radii": [radius_mm],
        "sensitivities": [0.0],
        "intersectPlaneDistance": before_mm,
    }
    return iset_json(polynomials, raypass, planeoffsetinput=before_mm), residuals


def light_of_pixels(lens: LensSection, focus_m: float, width: int, height: int) -> Numbers:
    """E/L of pixels of 1 mm, (rows, columns): the projected solid angle of what passes, counted on a grid of rays."""
    traced, distance = traced_lens(lens), cardinal_points(lens).image_distance(focus_m)
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2
    heights = np.hypot(x, y[:, None])
    some = np.linspace(0, heights.max(), 9)
    edge = traced.reach(distance, float(some[-1]))
    grid, step = np.linspace(-edge, edge, 401, retstep=True)
    counted = []
    for at in some:
        ray = ray_to(distance, np.array(at), grid[:, None], grid)
        with np.errstate(all="ignore"):  # rays that miss a surface
            passes = np.asarray(traced.unvignetted(ray))
        counted.append((passes * ray.dz**4).sum() * (step / distance) ** 2)
    return np.interp(heights, some, counted)


def fitted_lens(
    lens: TracedLens, window: tuple[float, float, float], degree: int
) -> tuple[dict[str, Any], Numbers]:
    """A file of another lens whose input plane is its reference plane, and the largest residual of each output.

    window : highest r, and the radius of the exit pupil and its distance from the input plane [mm]; the ellipses of its
    pass function lie there.
    """
    highest, radius, pupil = window
    rng = np.random.default_rng(7)
    r = highest * np.sqrt(rng.uniform(0, 1, 6000))
    across, along = 1.3 * radius * rng.uniform(-1, 1, (2, r.size))
    start, end = _traced(lens, r, across, along, pupil)
    passes = np.asarray(end.unvignetted)
    inputs = np.stack([start.y, start.dx, start.dy], axis=1)[passes]
    outputs = np.stack([end.x, end.y, end.dx, end.dy], axis=1)
    outputs[:, :2] -= (np.stack([end.dx, end.dy]) / end.dz * end.z).T
    polynomials, residuals = fitted_polynomials(inputs, outputs[passes], degree)
    raypass = {"intersectPlaneDistance": pupil, **_ellipses(lens, highest, radius, pupil)}
    return iset_json(polynomials, raypass), residuals


def _traced(
    lens: TracedLens, r: Numbers, across: Numbers, along: Numbers, pupil: float
) -> tuple[Ray, Ray]:
    """Rays from (0, r) in the input plane to points of the pupil, and what becomes of them."""
    r, across, along = np.broadcast_arrays(r, across, along)
    size = np.sqrt(across**2 + (along - r) ** 2 + pupil**2)
    start = Ray(0 * r, r, 0 * r, across / size, (along - r) / size, pupil / size, r >= 0)
    with np.errstate(all="ignore"):
        return start, lens.trace(start)


def _ellipses(lens: TracedLens, highest: float, radius: float, pupil: float) -> dict[str, Any]:
    """As wide and as high as what passes at 41 heights, in steps of 0.5 % of the radius of the pupil."""
    r, grid = np.linspace(0, highest, 41), 1.5 * radius * np.linspace(-1, 1, 601)
    _, along = _traced(lens, r[:, None], 0 * grid, grid, pupil)
    low = np.where(along.unvignetted, grid, np.inf).min(axis=1)
    high = np.where(along.unvignetted, grid, -np.inf).max(axis=1)
    middle = (low + high) / 2
    _, across = _traced(lens, r[:, None], grid, middle[:, None], pupil)
    width = np.where(across.unvignetted, grid, 0).max(axis=1)
    return {
        "method": "minimalellipse",
        "positions": r.tolist(),
        "centersX": [0.0] * r.size,
        "centersY": middle.tolist(),
        "radiiX": width.tolist(),
        "radiiY": ((high - low) / 2).tolist(),
    }
