"""Motion in the image: where scene points are imaged at another time (optical flow), and the largest image speed."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..core.types import Float64Array
from .animated_transforms import AnimatedTransforms
from .rays import SurfaceHits, intersect, pixel_rays, project
from .scene import Scene
from .variants import MitsubaObject

PROBES = 32  # rays along each side of the image that look for the largest speed
INSTANTS = (
    0.0,
    0.25,
    0.5,
    0.75,
    1.0,
)  # when they look, as fractions of the time from first row open to last row closed
DIFFERENCE = 1 / 256  # of that time: speeds are differences over it, with 0.03 px of rounding in all


def max_image_speed(scene: Scene, transforms: AnimatedTransforms, span_s: tuple[float, float]) -> float:
    """The largest speed of anything in the image [px/s], at five instants from end to end of ``span_s``.

    Of all that a grid of rays meets, and of the corners of the bounding boxes of the moved shapes, where they are in
    view.
    """
    length = span_s[1] - span_s[0]
    if length == 0:
        return 0.0
    times = [span_s[0] + fraction * length for fraction in INSTANTS]
    return max(_image_speed(scene, transforms, time_s, length * DIFFERENCE) for time_s in times)


def _image_speed(scene: Scene, transforms: AnimatedTransforms, at_s: float, difference_s: float) -> float:
    transforms.set_time(at_s)
    (width, height), (left, top) = scene.view.crop_size, scene.view.crop_offset
    x, y = (np.unique(np.linspace(0, n - 1, PROBES).round()) + 0.5 for n in (width, height))
    grid: Float64Array = np.stack(np.meshgrid(left + x, top + y), axis=-1).reshape(-1, 2)
    points, hits = first_hits(scene, transforms.camera_at(at_s), *pixel_rays(scene, grid))
    shapes = hits.shape
    for name in transforms.motion.objects:
        index = transforms.names.index(name)
        corners = np.array(list(product(*_bounding_box(scene.mitsuba_scene.shapes()[index]).T, [1.0])))
        points, grid = np.concatenate([points, corners]), np.concatenate([grid, np.tile(np.mean(grid, axis=0), (8, 1))])
        shapes = np.concatenate([shapes, np.full(8, index)])
    before = reproject(scene, transforms, points, shapes, grid, (at_s, at_s))
    after = reproject(scene, transforms, points, shapes, before, (at_s, at_s + difference_s))
    inside = (np.abs(before - (left + width / 2, top + height / 2)) <= (width / 2, height / 2)).all(axis=1)
    moved = np.hypot(*(after - before)[inside].T)
    return float(np.nanmax(moved, initial=0.0)) / difference_s


def _bounding_box(shape: MitsubaObject) -> Float64Array:
    """(2, 3) corners of the bounding box of a shape."""
    return np.array([shape.bbox().min, shape.bbox().max], dtype=np.float64).reshape(2, 3)


def first_hits(
    scene: Scene, camera: Float64Array, origins: Float64Array, directions: Float64Array, albedo: bool = False
) -> tuple[Float64Array, SurfaceHits]:
    """First surfaces along rays of the camera's frame, also as homogeneous world points (N, 4).

    Without a surface the point is the direction, with a last component of 0.  camera : 4×4 to world space.
    """
    world = directions @ camera[:3, :3].T
    unit = world / np.linalg.norm(world, axis=1, keepdims=True)
    hits = intersect(scene, origins @ camera[:3, :3].T + camera[:3, 3], unit, albedo)
    points = np.where(hits.found[:, None], hits.position, world)
    return np.column_stack([points, hits.found]), hits


def reproject(
    scene: Scene,
    transforms: AnimatedTransforms,
    points: Float64Array,
    shapes: NDArray[np.intp],
    guess: Float64Array,
    times_s: tuple[float, float],
) -> Float64Array:
    """Positions on the film (N, 2) [pixels] at the second time, of points (N, 4) on these shapes at the first time."""
    moved = transforms.carried(points, shapes, *times_s)
    return project(scene, moved @ np.linalg.inv(transforms.camera_at(times_s[1])).T, guess)
