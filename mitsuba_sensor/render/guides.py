"""Auxiliary images of the denoiser: reflectance behind each colour filter and normals, averaged over pixel and pupil.

Rays follow mirrors and clear glass to the first surface that scatters, so that what is seen in them guides too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Float64Array
from ..core.llvm import drjit
from .passes import hashed_seed
from .variants import MitsubaObject, mitsuba

if TYPE_CHECKING:
    from .scene import Scene

MOST_BOUNCES = 6  # at mirrors and clear glass
FEWEST_RAYS, MOST_RAYS = 64, 1024  # per pixel; noise of the guides stays in the denoised light (benchmarks/denoise.py)
RAYS_IN_ALL = 2**23  # of small pictures; a ray takes about a quarter of the time of a light path
RAYS_IN_FLIGHT = 2**21
QUARTERS = 4  # wavelengths that Mitsuba evaluates at once


@dataclass(frozen=True)
class Guides:
    """reflectance : (H, W, F) diffuse reflectance of the first surface that scatters, at what each filter detects; 1
    where nothing diffuse is met.  normal : (H, W, 3) its shading normal in world space; 0 where no surface is met."""

    reflectance: NDArray[np.float32]
    normal: NDArray[np.float32]


def render_guides(
    scene: Scene, wavelengths_nm: Float64Array, seed: int, rays: int, rows: tuple[int, int]
) -> NDArray[np.float32]:
    """Guides of rows [first, last) of the crop at the scene's present pose, (rows, columns, F + 3).

    wavelengths_nm : (F, 4) where each filter's reflectance is averaged.  rays : per pixel.  Not for scalar variants.
    """
    (columns, _), per_launch = scene.view.crop_size, max(RAYS_IN_FLIGHT // (rays * scene.view.crop_size[0]), 1)
    found = np.empty((rows[1] - rows[0], columns, len(wavelengths_nm) + 3), np.float32)
    for first in range(rows[0], rows[1], per_launch):
        strip = first, min(first + per_launch, rows[1])
        here = slice(first - rows[0], strip[1] - rows[0])
        found[here] = _strip(scene, wavelengths_nm, hashed_seed(seed, 2, first), rays, strip, columns)
    return found


def detected_quarters(weights: Float64Array, spectrum: Float64Array, wavelengths_nm: Float64Array) -> Float64Array:
    """Wavelengths in the middles of quarters of what each filter detects of light, (F, 4) [nm].

    weights : (F, B) photoelectrons of 1 W m⁻² nm⁻¹ in each band.  spectrum : (B,) of the light.
    """
    detected = np.cumsum(weights * spectrum + np.finfo(float).tiny, axis=1)
    middles = (detected - 0.5 * np.diff(detected, axis=1, prepend=0.0)) / detected[:, -1:]
    quarters = (np.arange(QUARTERS) + 0.5) / QUARTERS
    return np.array([np.interp(quarters, one, wavelengths_nm) for one in middles])


def rays_per_pixel(pixels: int) -> int:
    """A square number, more for small pictures: 1024 up to 90 × 90, 64 from 360 × 360 on."""
    return whole_square(min(max(RAYS_IN_ALL / pixels, FEWEST_RAYS), MOST_RAYS))


def whole_square(count: float) -> int:
    """The square number below, at least 1."""
    return max(int(count**0.5), 1) ** 2


def _strip(
    scene: Scene, wavelengths_nm: Float64Array, seed: int, rays: int, rows: tuple[int, int], columns: int
) -> NDArray[np.float32]:
    mi, dr = mitsuba(), drjit()
    index = dr.arange(mi.UInt32, (rows[1] - rows[0]) * columns * rays)
    pixel, random = index // rays, mi.PCG32(size=dr.width(index), initstate=dr.opaque(mi.UInt64, seed))
    ray = _camera_rays(scene, pixel, index % rays, random, rays, rows[0], columns)
    hit = _first_scattering(scene.mitsuba_scene, ray, random)
    valid = hit.is_valid()
    channels = [_reflectance(hit, valid, nm) for nm in wavelengths_nm]
    normal = dr.select(valid, hit.sh_frame.n, 0.0)
    sums = [dr.block_reduce(dr.ReduceOp.Add, mi.Float(x), rays) for x in (*channels, normal.x, normal.y, normal.z)]
    dr.eval(sums)
    found = np.stack([np.array(x, dtype=np.float32) for x in sums], axis=-1) / np.float32(rays)
    return np.asarray(found.reshape(rows[1] - rows[0], columns, -1))


def _camera_rays(
    scene: Scene, pixel: Array, number: Array, random: MitsubaObject, rays: int, first_row: int, columns: int
) -> MitsubaObject:
    """Rays through points of each pixel, one in each cell of a square grid, and random points of the pupil."""
    mi, film = mitsuba(), scene.sensor.film()
    side = round(rays**0.5)
    height, offset = float(film.crop_size()[1]), float(film.crop_offset()[1]) - scene.view.crop_offset[1]
    u = (mi.Float(number % side) + random.next_float32()) / side
    v = (mi.Float(number // side) + random.next_float32()) / side
    row = mi.Float(pixel // columns) + drjit().opaque(mi.Float, first_row - offset)
    place = mi.Point2f((mi.Float(pixel % columns) + u) / columns, (row + v) / height)
    wavelength, pupil = random.next_float32(), mi.Point2f(random.next_float32(), random.next_float32())
    return mi.Ray3f(scene.sensor.sample_ray(0.0, wavelength, place, pupil)[0])


def _first_scattering(scene: MitsubaObject, ray: MitsubaObject, random: MitsubaObject) -> MitsubaObject:
    """The first intersection of each ray with a surface that is neither a mirror nor clear."""
    mi, dr = mitsuba(), drjit()
    context, flags = mi.BSDFContext(), mi.BSDFFlags

    def again(active: Array, *_: object) -> Array:
        return active

    def follow(
        active: Array, bounce: Array, ray: MitsubaObject, random: MitsubaObject, hit: MitsubaObject
    ) -> tuple[object, ...]:
        found = scene.ray_intersect(ray, active)
        hit = dr.select(active, found, hit)
        bsdf = found.bsdf()
        clear = active & found.is_valid() & ~mi.has_flag(bsdf.flags(), flags.Smooth)
        clear &= mi.has_flag(bsdf.flags(), flags.Delta) & (bounce < MOST_BOUNCES)
        choice, direction = random.next_float32(), mi.Point2f(random.next_float32(), random.next_float32())
        sample, _ = bsdf.sample(context, found, choice, direction, clear)
        ray = dr.select(clear, found.spawn_ray(found.to_world(sample.wo)), ray)
        return clear, bounce + 1, ray, random, hit

    start = (mi.Bool(True), mi.UInt32(0), ray, random, dr.zeros(mi.SurfaceInteraction3f))
    return dr.while_loop(start, again, follow, labels=("active", "bounce", "ray", "random", "hit"))[-1]


def _reflectance(hit: MitsubaObject, valid: Array, wavelengths_nm: Float64Array) -> Array:
    """Mean diffuse reflectance at four wavelengths; 1 without a diffuse part, and on the shapes of emitters."""
    mi, dr = mitsuba(), drjit()
    hit.wavelengths = mi.Spectrum([float(nm) for nm in wavelengths_nm])
    bsdf = hit.bsdf()
    values = bsdf.eval_diffuse_reflectance(hit, valid)
    mean = dr.clip((values[0] + values[1] + values[2] + values[3]) / QUARTERS, 0.0, 1.0)
    diffuse = valid & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse) & ~hit.shape.is_emitter()
    return dr.select(diffuse, mean, 1.0)
