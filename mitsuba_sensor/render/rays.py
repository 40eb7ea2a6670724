"""One ray through each pixel and the centre of the pupil: what it hits, and which pixel sees a given point.

The rays are the sensor's own, so they go through whatever lens the scene has. In scalar variants they are traced one by
one, in LLVM and CUDA all at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.llvm import drjit
from .scene import Scene
from .variants import mitsuba

Floats = NDArray[np.float64]
RGB_NM = ((600.0, 700.0), (500.0, 600.0), (400.0, 500.0))  # thirds of the visible, about the sensor's red, green, blue
ROUNDS, CLOSE_PX, LOST_PX = 8, 1e-3, 0.1  # of the search in project; float32 rays hold 1e-4 px over 1000 columns
NO_SHAPE = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays meet first, glass and the shapes of emitters included.

    found : (N,) whether there is anything.  position : (N, 3) [m].  normal : (N, 3) shading normal, as the surface has
    it (outwards; not turned to the camera).  shape : (N,) place in the order of the scene file, −1 for nothing.
    albedo : (N, 3) diffuse reflectance, mean over 600–700, 500–600 and 400–500 nm; 0 for metals and clear glass.
    """

    found: NDArray[np.bool_]
    position: Floats
    normal: Floats
    shape: NDArray[np.intp]
    albedo: Floats


def pose_of(sensor: Any) -> Floats:
    """4×4 from the camera's frame (x left, y up, z forward) to the world, as the sensor stands now."""
    return matrix_of(mitsuba().traverse(sensor)["to_world"])


def matrix_of(transform: Any) -> Floats:
    """A Mitsuba transform as 4×4 float64."""
    return np.array(transform.matrix, dtype=np.float64).reshape(4, 4)


def pixel_rays(scene: Scene, pixels: Floats) -> tuple[Floats, Floats]:
    """Origins and directions, (N, 3), in the camera's frame; NaN where the lens lets no light through to a pixel.

    pixels : (N, 2) places on the whole film, x to the right and y down; the first pixel's centre is (0.5, 0.5).
    """
    mi, film = mitsuba(), scene.sensor.film()
    size, offset = np.array(film.crop_size(), float), np.array(film.crop_offset(), float)
    places, centre = (pixels - offset.ravel()) / size.ravel(), mi.Point2f(0.5, 0.5)

    def ray(x: Any, y: Any) -> tuple[Any, ...]:
        made, _ = scene.sensor.sample_ray(0.0, 0.5, mi.Point2f(x, y), centre)
        return made.o, made.d, made.maxt

    origins, directions, reach = _each(ray, places)
    back = np.linalg.inv(pose_of(scene.sensor))
    directions = np.where(reach.reshape(-1, 1) > 0, directions, np.nan)  # a traced lens stops rays so
    return origins @ back[:3, :3].T + back[:3, 3], directions @ back[:3, :3].T


def intersect(scene: Scene, origins: Floats, directions: Floats, albedo: bool = True) -> Hits:
    """What rays in world space meet, as the scene stands now; a direction of NaN meets nothing.

    albedo : False leaves it at 0.
    """
    mi, shapes = mitsuba(), list(scene.native.shapes())
    handle, table = _numbering(mi, shapes)

    def look(*ray: Any) -> tuple[Any, ...]:
        hit = scene.native.ray_intersect(mi.Ray3f(mi.Point3f(*ray[:3]), mi.Vector3f(*ray[3:])))
        colour = _albedo(mi, hit) if albedo else (0.0, 0.0, 0.0)
        return hit.is_valid(), hit.p, hit.sh_frame.n, handle(hit), *colour

    open_ = np.isfinite(directions).all(axis=1)
    rays = np.concatenate([origins, np.where(open_[:, None], directions, (0.0, 0.0, 1.0))], axis=1)
    found, position, normal, handles, *colour = _each(look, rays)
    there = found.astype(bool).ravel() & open_
    rgb = np.stack([np.broadcast_to(c.ravel(), there.shape) for c in colour], axis=-1)
    keep = there[:, None]
    return Hits(
        there,
        np.where(keep, position, np.nan),
        np.where(keep, normal, 0.0),
        np.where(there, table[handles.ravel().astype(np.intp)], NO_SHAPE),
        np.where(keep, rgb, 0.0),
    )


def project(scene: Scene, points: Floats, guess: Floats) -> Floats:
    """Pixel places (N, 2) that see points of the camera's frame; NaN where none does.

    points : (N, 4) homogeneous; a last component of 0 is a direction, infinitely far.  guess : (N, 2) near the answer.
    Newton's method on the sensor's own rays (one round for a pinhole or thin lens, whose film is flat): the ray through
    the answer passes through the point.
    """
    pixels, ahead = np.array(guess, dtype=float), points[:, 2] > 0
    pixels[~ahead] = np.nan
    slope, rest, step = None, np.flatnonzero(ahead), np.zeros((0, 2))
    for _ in range(ROUNDS):
        if not rest.size:
            break
        miss = _miss(scene, points[rest], pixels[rest])
        if slope is None:
            slope = _inverse(*(_miss(scene, points[rest], pixels[rest] + side) - miss for side in np.eye(2)))
        step = np.einsum("nij,nj->ni", slope, miss)
        pixels[rest] -= step
        far = np.abs(step).max(axis=1) > CLOSE_PX
        rest, slope, step = rest[far], slope[far], step[far]
    pixels[rest[np.abs(step).max(axis=1, initial=0) > LOST_PX]] = np.nan
    return pixels


def _inverse(x: Floats, y: Floats) -> Floats:
    """(N, 2, 2) inverses of the matrices with these columns, (N, 2); not finite where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (x[:, 0] * y[:, 1] - y[:, 0] * x[:, 1])
        return np.array([[y[:, 1], -y[:, 0]], [-x[:, 1], x[:, 0]]]).transpose(2, 0, 1) * scale[:, None, None]


def _miss(scene: Scene, points: Floats, pixels: Floats) -> Floats:
    """(N, 2) by which the rays of the pixels pass points beside them, in their plane."""
    origins, directions = pixel_rays(scene, pixels)
    along = (points[:, 2] - points[:, 3] * origins[:, 2]) / directions[:, 2]
    passed = points[:, 3:] * origins[:, :2] + along[:, None] * directions[:, :2]
    return passed - points[:, :2]


def _each(function: Any, inputs: Floats) -> list[Floats]:
    """Outputs, (N, …), of a function of Mitsuba's numbers at (N, k) inputs: at once, or one by one in scalar."""
    mi = mitsuba()
    if not mi.variant().startswith("scalar"):
        # From a list they lie where a vector may start; NumPy's may not, and each case compiles a kernel (0.7 s).
        outputs = function(*(mi.Float(column.tolist()) for column in inputs.T))
        drjit().eval(outputs)
        arrays = [np.atleast_1d(np.array(out, dtype=np.float64).T) for out in outputs]
        return [np.broadcast_to(x, (len(inputs), *x.shape[1:])) for x in arrays]  # parallel rays are given once
    rows = [[np.array(out, dtype=np.float64) for out in function(*row)] for row in inputs.tolist()]
    return [np.array(column) for column in zip(*rows, strict=True)]


def _numbering(mi: Any, shapes: list[Any]) -> tuple[Callable[[Any], Any], NDArray[np.intp]]:
    """A function from a hit to a handle, and the place of each handle among the shapes of the scene.

    An instance counts, not the shape inside it. Handle 0 is nothing.
    """
    if mi.variant().startswith("scalar"):
        handles = {shape: k + 1 for k, shape in enumerate(shapes)}
        return lambda hit: handles[hit.instance or hit.shape] if hit.is_valid() else 0, np.arange(len(shapes) + 1) - 1
    dr = drjit()

    def handle(hit: Any) -> Any:
        instance = dr.reinterpret_array(mi.UInt32, hit.instance)
        return dr.select(instance != 0, instance, dr.reinterpret_array(mi.UInt32, hit.shape))

    numbers = [int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]) for shape in shapes]
    table = np.full(max(numbers, default=0) + 1, NO_SHAPE)
    table[numbers] = np.arange(len(shapes))
    return handle, table


def _albedo(mi: Any, hit: Any) -> tuple[Any, ...]:
    """Diffuse reflectance in three bands: each the mean of the middles of its four quarters, under equal energy.

    Only of materials with a diffuse part: of others Mitsuba would give the value of the lobe, which may be far above 1.
    """
    there, colour = hit.is_valid(), []
    if there is False:  # a scalar ray into the void, which has no surface to ask
        return (0.0, 0.0, 0.0)
    bsdf, scalar = hit.bsdf(), there is True
    diffuse = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
    for low, high in RGB_NM:
        hit.wavelengths = mi.Spectrum([low + (k + 0.5) * (high - low) / 4 for k in range(4)])
        quarters = bsdf.eval_diffuse_reflectance(hit, there)
        mean = (quarters[0] + quarters[1] + quarters[2] + quarters[3]) / 4
        colour.append(min(mean, 1.0) * diffuse if scalar else drjit().select(diffuse, drjit().minimum(mean, 1.0), 0.0))
    return tuple(colour)
