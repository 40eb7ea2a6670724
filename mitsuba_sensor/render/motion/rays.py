"""Intersections of one ray per pixel with the scene, and projection of scene points onto pixels.

The sensor samples the rays at the centre of the pupil, so they include the lens. Scalar variants trace them
individually, LLVM and CUDA variants all at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Array, Float64Array
from ...core.llvm import drjit
from ..load.scene import Scene
from ..variants import MitsubaObject, evaluate, mitsuba

RGB_NM = ((600.0, 700.0), (500.0, 600.0), (400.0, 500.0))
"""Thirds of the visible range, approximately the red, green and blue of a sensor."""
NEWTON_STEPS = 8  # of project
CONVERGED_PX = 1e-3  # largest last step; float32 rays are accurate to 1e-4 px over 1000 columns
LOST_PX = 0.1  # points with larger last steps are not imaged
NO_SHAPE = -1


class SurfaceHits(NamedTuple):
    """The first surfaces that N rays meet, including glass and the shapes of emitters.

    found : True for a surface, shape (N,).  position : in scene units, shape (N, 3); NaN without a surface.
    points : homogeneous positions, shape (N, 4); without a surface the direction, with a last component of 0.
    normal : outward shading normal, not turned to the camera, shape (N, 3).
    shape : index in the order of the scene file, shape (N,); −1 without a surface.
    albedo : diffuse reflectance, mean over 600–700, 500–600 and 400–500 nm, shape (N, 3); 0 for metals and clear glass.
    """

    found: NDArray[np.bool_]
    position: Float64Array
    points: Float64Array
    normal: Float64Array
    shape: NDArray[np.intp]
    albedo: Float64Array


def camera_to_world(sensor: MitsubaObject) -> Float64Array:
    """Return the present pose of a sensor, shape (4, 4), from its frame (x left, y up, z forward) to the world."""
    matrix = mitsuba().traverse(sensor)["to_world"].matrix
    return np.array(matrix, dtype=np.float64).reshape(4, 4)


def pixel_rays(scene: Scene, pixels: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return origins and directions in the camera's frame, shape (N, 3) each; NaN for a pixel without light.

    pixels : positions on the whole film, shape (N, 2), x to the right and y down; the first pixel's centre is (0.5,
        0.5).
    """
    mi, film = mitsuba(), scene.sensor.film()
    size, offset = np.array(film.crop_size(), float), np.array(film.crop_offset(), float)
    positions, pupil_centre = (pixels - offset.ravel()) / size.ravel(), mi.Point2f(0.5, 0.5)

    def sample_ray(x: Array, y: Array) -> tuple[Array, ...]:
        ray, _ = scene.sharp.sample_ray(0.0, 0.5, mi.Point2f(x, y), pupil_centre)
        return ray.o, ray.d, ray.maxt

    origins, directions, maxt = evaluate(sample_ray, positions)
    to_camera = np.linalg.inv(camera_to_world(scene.sensor))
    # maxt is 0 for vignetted rays.
    directions = np.where(maxt.reshape(-1, 1) > 0, directions, np.nan)
    return origins @ to_camera[:3, :3].T + to_camera[:3, 3], directions @ to_camera[:3, :3].T


def first_hits(
    scene: Scene, camera: Float64Array, pixels: Float64Array, albedo: bool = False
) -> SurfaceHits:
    """Return the first surfaces along the rays of pixels, shape (N, 2), at the present pose of the scene.

    camera : pose of the camera, shape (4, 4).  albedo : False leaves the albedo at 0.
    """
    mi, (origins, directions) = mitsuba(), pixel_rays(scene, pixels)
    handle_of, index_of_handle = _shape_numbering(list(scene.mitsuba_scene.shapes()))

    def first_surface(*ray: Array) -> tuple[Array, ...]:
        hit = scene.mitsuba_scene.ray_intersect(
            mi.Ray3f(mi.Point3f(*ray[:3]), mi.Vector3f(*ray[3:]))
        )
        colour = _albedo(hit) if albedo else (0.0, 0.0, 0.0)
        return hit.is_valid(), hit.p, hit.sh_frame.n, handle_of(hit), *colour

    world = directions @ camera[:3, :3].T
    unit = world / np.linalg.norm(world, axis=1, keepdims=True)
    finite = np.asarray(np.isfinite(unit).all(axis=1))
    starts = origins @ camera[:3, :3].T + camera[:3, 3]
    ahead = np.where(finite[:, None], unit, (0.0, 0.0, 1.0))
    rays = np.concatenate([starts, ahead], axis=1)
    valid, position, normal, handles, *colour = evaluate(first_surface, rays)
    found = valid.astype(bool).ravel() & finite
    at = found[:, None]
    rgb = np.stack([np.broadcast_to(c.ravel(), found.shape) for c in colour], axis=-1)
    return SurfaceHits(
        found,
        np.where(at, position, np.nan),
        np.column_stack([np.where(at, position, world), found]),
        np.where(at, normal, 0.0),
        np.where(found, index_of_handle[handles.ravel().astype(np.intp)], NO_SHAPE),
        np.where(at, rgb, 0.0),
    )


def project(scene: Scene, points: Float64Array, guess: Float64Array) -> Float64Array:
    """Return the positions on the film [pixels] of points in the camera's frame, shape (N, 2); NaN for points that are
    not imaged.

    points : homogeneous, shape (N, 4); a last component of 0 is a direction, infinitely far.
    guess : first estimate, shape (N, 2).

    Newton's method on the rays of the sensor; a pinhole or thin lens with a flat film needs one step.
    """
    pixels, ahead = np.array(guess, dtype=float), points[:, 2] > 0
    pixels[~ahead] = np.nan
    slope, rest, step = None, np.flatnonzero(ahead), np.zeros((0, 2))
    for _ in range(NEWTON_STEPS):
        if not rest.size:
            break
        miss = _miss(scene, points[rest], pixels[rest])
        if slope is None:
            x, y = (
                _miss(scene, points[rest], pixels[rest] + side) - miss for side in np.eye(2)
            )
            adjugate = np.array([[y[:, 1], -y[:, 0]], [-x[:, 1], x[:, 0]]]).transpose(2, 0, 1)
            with np.errstate(divide="ignore", invalid="ignore"):  # of singular matrices
                scale = 1 / (x[:, 0] * y[:, 1] - y[:, 0] * x[:, 1])
                slope = adjugate * scale[:, None, None]
        step = np.einsum("nij,nj->ni", slope, miss)
        pixels[rest] -= step
        far = np.asarray(np.abs(step).max(axis=1) > CONVERGED_PX)
        rest, slope, step = rest[far], slope[far], step[far]
    pixels[rest[np.abs(step).max(axis=1, initial=0) > LOST_PX]] = np.nan
    return pixels


def _miss(scene: Scene, points: Float64Array, pixels: Float64Array) -> Float64Array:
    """Return the transverse distance of the rays of pixels from points, in the plane of each point, shape (N, 2)."""
    origins, directions = pixel_rays(scene, pixels)
    along = (points[:, 2] - points[:, 3] * origins[:, 2]) / directions[:, 2]
    passed = points[:, 3:] * origins[:, :2] + along[:, None] * directions[:, :2]
    return passed - points[:, :2]


def _shape_numbering(
    shapes: list[MitsubaObject],
) -> tuple[Callable[[MitsubaObject], Array], NDArray[np.intp]]:
    """Return a function that gives the handle of the shape, or instance, of an intersection (0 without), and the index
    in the scene of each handle."""
    mi, dr = mitsuba(), drjit()
    if mi.variant().startswith("scalar"):
        handles = {shape: k + 1 for k, shape in enumerate(shapes)}
        return (
            lambda hit: handles[hit.instance or hit.shape] if hit.is_valid() else 0,
            np.arange(len(shapes) + 1) - 1,
        )

    def handle(hit: MitsubaObject) -> Array:
        instance = dr.reinterpret_array(mi.UInt32, hit.instance)
        return dr.select(instance != 0, instance, dr.reinterpret_array(mi.UInt32, hit.shape))

    numbers = [
        int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])
        for shape in shapes
    ]
    table = np.full(max(numbers, default=0) + 1, NO_SHAPE)
    table[numbers] = np.arange(len(shapes))
    return handle, table


def _albedo(hit: MitsubaObject) -> tuple[Array, ...]:
    """Return the diffuse reflectance in three bands, each the mean of the centres of its four quarters; 0 without a
    diffuse component, for which Mitsuba would return the value of the lobe, possibly far above 1."""
    mi, dr, valid = mitsuba(), drjit(), hit.is_valid()
    if valid is False:  # a scalar ray without a surface, which has no material
        return (0.0, 0.0, 0.0)
    bsdf, colour = hit.bsdf(), []
    diffuse = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
    for low, high in RGB_NM:
        hit.wavelengths = mi.UnpolarizedSpectrum(
            [low + (k + 0.5) * (high - low) / 4 for k in range(4)]
        )
        quarters = mi.unpolarized_spectrum(bsdf.eval_diffuse_reflectance(hit, valid))
        mean = (quarters[0] + quarters[1] + quarters[2] + quarters[3]) / 4
        colour.append(dr.select(diffuse, dr.minimum(mean, 1.0), 0.0))
    return tuple(colour)
