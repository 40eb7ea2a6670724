"""Auxiliary images for the denoiser: albedo for each colour filter and normals, averaged over pixel and pupil.

Rays continue through mirrors and clear glass to the first surface that scatters, so images in mirrors also guide.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Array, Float64Array
from ...core.llvm import drjit
from ..load.scene import Scene
from ..samples import hashed_seed
from ..variants import MitsubaObject, mitsuba

BOUNCES_MAX = 6  # at mirrors and clear glass
SIDE_MIN, SIDE_MAX = 4, 16  # of the grid of rays in a pixel
RAYS_IN_FLIGHT = 2**21
QUARTERS = 4  # wavelengths that Mitsuba evaluates at once


class Guides(NamedTuple):
    """Properties of the first surface that scatters.

    albedo : (H, W, F) diffuse albedo at the wavelengths that each filter detects; 1 without a diffuse surface.
    normal : (H, W, 3) shading normal in world space; 0 without a surface.
    """

    albedo: NDArray[np.float32]
    normal: NDArray[np.float32]


def rays_for(samples: float) -> int:
    """Return the rays per pixel, a square number: 16 for 16 samples per pixel or fewer, 256 for 64 or more.

    Noise of the guides stays in the light, and shows more in light with less noise.
    """
    return int(min(max(samples / 4, SIDE_MIN), SIDE_MAX)) ** 2


def trace_guides(
    scene: Scene, wavelengths_nm: Float64Array, seed: int, rays: int, rows: tuple[int, int]
) -> NDArray[np.float32]:
    """Return albedo and normal for rows [first, last) of the crop at the scene's present pose, (rows, columns, F + 3).

    wavelengths_nm : (F, 4) at which each filter's albedo is averaged.  rays : per pixel, a square number. Not for
    scalar variants, in which a ray takes 0.1 ms of Python.
    """
    columns, parts = scene.view.crop_size[0], []
    step = max(RAYS_IN_FLIGHT // (rays * columns), 1)
    for first in range(*rows, step):
        strip = first, min(first + step, rows[1])
        parts.append(
            _trace_strip(scene, wavelengths_nm, hashed_seed(seed, 2, first), rays, strip)
        )
    return np.concatenate(parts)


def detected_quarters(
    weights: Float64Array, spectrum: Float64Array, wavelengths_nm: Float64Array
) -> Float64Array:
    """Return wavelengths in the middle of each quarter of the photoelectrons of a filter, (F, 4) [nm].

    weights : (F, B) photoelectrons for 1 W m⁻² nm⁻¹ in each band.  spectrum : (B,) of the light.
    """
    detected = np.cumsum(weights * spectrum + np.finfo(float).tiny, axis=1)
    middles = (detected - 0.5 * np.diff(detected, axis=1, prepend=0.0)) / detected[:, -1:]
    quarters = (np.arange(QUARTERS) + 0.5) / QUARTERS
    return np.array([np.interp(quarters, shares, wavelengths_nm) for shares in middles])


def _trace_strip(
    scene: Scene, wavelengths_nm: Float64Array, seed: int, rays: int, rows: tuple[int, int]
) -> NDArray[np.float32]:
    """Return the guides of rows that fit into one launch."""
    mi, dr = mitsuba(), drjit()
    columns = scene.view.crop_size[0]
    pixels = (rows[1] - rows[0]) * columns
    index = dr.arange(mi.UInt32, pixels * rays)
    per_pixel, side = dr.opaque(mi.UInt32, rays), dr.opaque(mi.UInt32, math.isqrt(rays))
    random = mi.PCG32(size=pixels * rays, initstate=dr.opaque(mi.UInt64, seed))
    number = index % per_pixel
    cell = mi.Float(number % side), mi.Float(number // side)
    # one ray in each cell of the pixel
    place = [(x + random.next_float32()) / mi.Float(side) for x in cell]
    ray = _camera_rays(scene, index // per_pixel, place, random, rows[0], columns)
    hit = _first_scattering(scene.mitsuba_scene, ray, random)
    valid = hit.is_valid()
    normal = dr.select(valid, hit.sh_frame.n, 0.0)
    channels = *_albedos(hit, valid, wavelengths_nm), normal.x, normal.y, normal.z
    values = [mi.Float(x) for x in channels]
    dr.eval(values)  # all in one kernel; each sum alone would trace the rays again
    sums = [np.array(dr.block_reduce(dr.ReduceOp.Add, x, rays), np.float32) for x in values]
    means = np.stack(sums, axis=-1) / np.float32(rays)
    return np.asarray(means.reshape(rows[1] - rows[0], columns, -1))


def _camera_rays(
    scene: Scene,
    pixel: Array,
    place: list[Array],
    random: MitsubaObject,
    first_row: int,
    columns: int,
) -> MitsubaObject:
    """Return rays through ``place`` in each pixel and a random point of the pupil; rows start at ``first_row``."""
    mi, film = mitsuba(), scene.sensor.film()
    height = float(film.crop_size()[1])
    offset = float(film.crop_offset()[1]) - scene.view.crop_offset[1]
    row = mi.Float(pixel // columns) + drjit().opaque(mi.Float, first_row - offset)
    column = mi.Float(pixel % columns)
    on_film = mi.Point2f((column + place[0]) / columns, (row + place[1]) / height)
    pupil = mi.Point2f(random.next_float32(), random.next_float32())
    ray, _ = scene.sensor.sample_ray(0.0, random.next_float32(), on_film, pupil)
    return mi.Ray3f(ray)


def _first_scattering(
    scene: MitsubaObject, ray: MitsubaObject, random: MitsubaObject
) -> MitsubaObject:
    """Return the first intersection of each ray with a surface that is neither a mirror nor clear."""
    mi, dr = mitsuba(), drjit()
    context, flags = mi.BSDFContext(), mi.BSDFFlags

    def again(active: Array, *_: object) -> Array:
        return active

    def follow(
        active: Array,
        bounce: Array,
        ray: MitsubaObject,
        random: MitsubaObject,
        hit: MitsubaObject,
    ) -> tuple[object, ...]:
        surface = scene.ray_intersect(ray, active)
        hit = dr.select(active, surface, hit)
        bsdf = surface.bsdf()
        clear = active & surface.is_valid() & ~mi.has_flag(bsdf.flags(), flags.Smooth)
        clear &= mi.has_flag(bsdf.flags(), flags.Delta) & (bounce < BOUNCES_MAX)
        choice = random.next_float32()
        direction = mi.Point2f(random.next_float32(), random.next_float32())
        sample, _ = bsdf.sample(context, surface, choice, direction, clear)
        ray = dr.select(clear, surface.spawn_ray(surface.to_world(sample.wo)), ray)
        return clear, bounce + 1, ray, random, hit

    start = (mi.Bool(True), mi.UInt32(0), ray, random, dr.zeros(mi.SurfaceInteraction3f))
    labels = ("active", "bounce", "ray", "random", "hit")
    *_, hit = dr.while_loop(start, again, follow, labels=labels)
    return hit


def _albedos(hit: MitsubaObject, valid: Array, wavelengths_nm: Float64Array) -> list[Array]:
    """Return the mean diffuse albedo at four wavelengths of each filter; 1 without a diffuse part, and on emitters.

    A loop over the filters compiles the code of each material once. The wavelengths are data of the kernel, because
    they follow from the rendered light and differ in every render.
    """
    mi, dr = mitsuba(), drjit()
    count, table = len(wavelengths_nm), mi.Float(np.ravel(wavelengths_nm).astype(np.float32))
    bsdf = hit.bsdf()
    diffuse = valid & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse) & ~hit.shape.is_emitter()

    def more(number: Array, *_: Array) -> Array:
        return number < count

    def evaluate(number: Array, *channels: Array) -> tuple[Array, ...]:
        interaction = mi.SurfaceInteraction3f(hit)
        quarters = [dr.gather(mi.Float, table, QUARTERS * number + k) for k in range(QUARTERS)]
        interaction.wavelengths = mi.UnpolarizedSpectrum(*quarters)
        values = mi.unpolarized_spectrum(bsdf.eval_diffuse_reflectance(interaction, diffuse))
        mean = dr.clip((values[0] + values[1] + values[2] + values[3]) / QUARTERS, 0.0, 1.0)
        changed = []
        for k, value in enumerate(channels):
            changed.append(dr.select(diffuse & (number == k), mean, value))
        return (number + 1, *changed)

    start = (mi.UInt32(0), *(mi.Float(1.0) for _ in range(count)))
    return list(dr.while_loop(start, more, evaluate)[1:])
