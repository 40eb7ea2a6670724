"""Auxiliary images of the denoiser: reflectance behind each colour filter and normals, averaged over pixel and pupil.

Rays follow mirrors and clear glass to the first surface that scatters, so that what is seen in them guides too. Light
is divided by the reflectance before it is filtered and multiplied by it afterwards, so that noise of the reflectance
stays in the light: rays are traced until it hardly adds to the render's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core import Array, Float64Array
from ...core.llvm import drjit
from ..passes.passes import hashed_seed
from ..variants import MitsubaObject, mitsuba

if TYPE_CHECKING:
    from ..scene.scene import Scene

MOST_BOUNCES = 6  # at mirrors and clear glass
FEWEST_RAYS, MOST_RAYS = 64, 1024  # per pixel
MOST_NOISE = 0.05  # of the render's, of which the denoiser removes nine tenths
RAYS_PER_SAMPLE, RAYS_OF_FEW = 4, 256
"""At most so many for a light path, of few paths; else one."""
DARKEST_REFLECTANCE = 0.02  # what is darker is not divided by its own
RAYS_IN_FLIGHT = 2**21
SOBOL = ((0, (1,) * 32), (0, (1,)), (1, (1, 3)), (1, (1, 3, 1)))
"""Polynomial and first direction numbers of each dimension."""
LAINE_KARRAS = 0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6
QUARTERS = 4  # wavelengths that Mitsuba evaluates at once

Trace: TypeAlias = Callable[[int, int], NDArray[np.float32]]
"""Traces so many rays of a set with this number, (H, W, F + 3)."""


@dataclass(frozen=True)
class Guides:
    """values : (H, W, F + 3) reflectance and normal.  rays : of each pixel, as asked for.  noise : (H, W, F) variance
    of the reflectance over its square."""

    values: NDArray[np.float32]
    rays: int
    noise: NDArray[np.float32]

    @classmethod
    def joined(
        cls, first: NDArray[np.float32], second: NDArray[np.float32], rays: int
    ) -> Guides:
        """Guides of two independent sets of rays, the first of which is written over; rays : of both."""
        noise = first[..., :-3] - second[..., :-3]
        first += second
        first *= 0.5
        noise /= 2 * np.maximum(first[..., :-3], DARKEST_REFLECTANCE)
        noise *= noise
        return cls(first, rays, noise)

    def without_noise(self) -> Guides:
        """The same values and rays, for who traces no more rays."""
        return replace(self, noise=np.empty(0, np.float32))

    @property
    def reflectance(self) -> NDArray[np.float32]:
        """(H, W, F) diffuse, of the first surface that scatters, at what each filter detects; 1 where nothing diffuse
        is met."""
        return self.values[..., :-3]

    @property
    def normal(self) -> NDArray[np.float32]:
        """(H, W, 3) shading normal of that surface in world space; 0 where no surface is met."""
        return self.values[..., -3:]


def traced(
    trace: Trace, most: int, share: Callable[[NDArray[np.float32]], float], known: Guides | None
) -> Guides:
    """Guides of so many rays that their noise is MOST_NOISE of the render's, or of ``most``; each time as many more as
    there were.

    share : of a noise (H, W, F) in the render's.  known : guides of the rays before.
    """
    guides = known
    if guides is None:
        half = FEWEST_RAYS // 2
        guides = Guides.joined(trace(half, 0), trace(half, 1), FEWEST_RAYS)
    while guides.rays < most and share(guides.noise) > MOST_NOISE:
        rays = guides.rays
        guides = Guides.joined(guides.values, trace(rays, rays.bit_length()), 2 * rays)
    return guides


def noise_share(
    noise: NDArray[np.floating], mean: Float64Array, variance: Float64Array
) -> float:
    """Mean over the pixels of the guides' noise over the render's, at most 1 in each; all (H, W), of the same filters.

    mean, variance : of the light and of its mean.
    """
    noisy = variance > 0
    if not noisy.any():
        return 0.0
    share = noise[noisy] * mean[noisy] ** 2 / variance[noisy]
    return float(np.minimum(share, 1.0).mean())


def render_guides(
    scene: Scene, wavelengths_nm: Float64Array, seed: int, rays: int, rows: tuple[int, int]
) -> NDArray[np.float32]:
    """Guides of rows [first, last) of the crop at the scene's present pose, (rows, columns, F + 3).

    wavelengths_nm : (F, 4) where each filter's reflectance is averaged.  rays : per pixel.  Not for scalar variants.
    """
    begin, end = rows
    columns, _ = scene.view.crop_size
    per_launch = max(RAYS_IN_FLIGHT // (rays * columns), 1)
    guides = np.empty((end - begin, columns, len(wavelengths_nm) + 3), np.float32)
    for first in range(begin, end, per_launch):
        last = min(first + per_launch, end)
        strip_seed = hashed_seed(seed, 2, first)
        guides[first - begin : last - begin] = _trace_strip(
            scene, wavelengths_nm, strip_seed, rays, (first, last), columns
        )
    return guides


def detected_quarters(
    weights: Float64Array, spectrum: Float64Array, wavelengths_nm: Float64Array
) -> Float64Array:
    """Wavelengths in the middles of quarters of what each filter detects of light, (F, 4) [nm].

    weights : (F, B) photoelectrons of 1 W m⁻² nm⁻¹ in each band.  spectrum : (B,) of the light.
    """
    detected = np.cumsum(weights * spectrum + np.finfo(float).tiny, axis=1)
    middles = (detected - 0.5 * np.diff(detected, axis=1, prepend=0.0)) / detected[:, -1:]
    quarters = (np.arange(QUARTERS) + 0.5) / QUARTERS
    return np.array([np.interp(quarters, shares, wavelengths_nm) for shares in middles])


def most_rays(samples: float) -> int:
    """Most rays of a pixel with so many light paths: a power of two, 64 … 1024.

    A ray takes a tenth of the time of a path, or as long where paths are very short.
    """
    of_few = min(RAYS_PER_SAMPLE * samples, RAYS_OF_FEW)
    return power_of_two(min(max(samples, of_few, FEWEST_RAYS), MOST_RAYS))


def power_of_two(count: float) -> int:
    """The power of two at or below a number, at least 1."""
    return 1 << (int(max(count, 1)).bit_length() - 1)


def _trace_strip(
    scene: Scene,
    wavelengths_nm: Float64Array,
    seed: int,
    rays: int,
    rows: tuple[int, int],
    columns: int,
) -> NDArray[np.float32]:
    """Guides of rows that are traced in one launch."""
    mi, dr = mitsuba(), drjit()
    pixels = (rows[1] - rows[0]) * columns
    pixel, points = scrambled_points(pixels, rays, seed)
    random = mi.PCG32(size=pixels * rays, initstate=dr.opaque(mi.UInt64, seed))
    ray = _camera_rays(scene, pixel, points, random.next_float32(), rows[0], columns)
    hit = _first_scattering(scene.mitsuba_scene, ray, random)
    valid = hit.is_valid()
    channels = _reflectances(hit, valid, wavelengths_nm)
    normal = dr.select(valid, hit.sh_frame.n, 0.0)
    values = [mi.Float(x) for x in (*channels, normal.x, normal.y, normal.z)]
    dr.eval(values)  # all in one kernel; a sum alone would trace the rays for itself
    sums = [dr.block_reduce(dr.ReduceOp.Add, x, rays) for x in values]
    images = [np.array(x, dtype=np.float32) for x in sums]
    means = np.stack(images, axis=-1) / np.float32(rays)
    return np.asarray(means.reshape(rows[1] - rows[0], columns, -1))


def sobol_points(count: int) -> NDArray[np.uint32]:
    """The first points of Sobol's sequence in four dimensions, (4, count), as fractions of 2³²; up to 2³² of them.

    Direction numbers of Joe and Kuo 2008, doi 10.1137/070709359.
    """
    number, points = np.arange(count, dtype=np.uint32), np.zeros((len(SOBOL), count), np.uint32)
    for axis, (polynomial, start) in enumerate(SOBOL):
        directions, degree = [m << (31 - k) for k, m in enumerate(start)], len(start)
        for k in range(degree, 32):
            direction = directions[k - degree] ^ (directions[k - degree] >> degree)
            for lag in range(1, degree):
                direction ^= directions[k - lag] * (polynomial >> (degree - 1 - lag) & 1)
            directions.append(direction)
        for k, direction in enumerate(directions):
            points[axis] ^= (number >> k & 1) * np.uint32(direction)
    return points


def scrambled_points(pixels: int, rays: int, seed: int) -> tuple[Array, list[Array]]:
    """Points of the unit cube in four dimensions, ``rays`` of each pixel: the pixel of each, and one array for each
    dimension. They are Sobol's, with their digits permuted for each pixel anew (Owen), by the hash of Laine and Karras
    2011, doi 10.1111/j.1467-8659.2011.01980.x.

    rays : a power of two; data of the kernel, so that it serves all of them.
    """
    mi, dr = mitsuba(), drjit()
    index = dr.arange(mi.UInt32, pixels * rays)
    random = mi.PCG32(pixels, initstate=dr.opaque(mi.UInt64, seed + 2**32))
    pixel = index >> dr.opaque(mi.UInt32, rays.bit_length() - 1)
    number = index & dr.opaque(mi.UInt32, rays - 1)
    points, shifts = [], [random.next_uint32() for _ in SOBOL]
    dr.eval(shifts)
    for column, shift in zip(sobol_points(rays), shifts, strict=True):
        reversed_digits = dr.brev(mi.UInt32(column))
        bits = dr.gather(mi.UInt32, reversed_digits, number)
        bits = bits + dr.gather(mi.UInt32, shift, pixel)
        for factor in LAINE_KARRAS:
            bits ^= bits * factor
        points.append(mi.Float(dr.brev(bits) >> 8) * 2.0**-24)
    return pixel, points


def _camera_rays(
    scene: Scene,
    pixel: Array,
    points: list[Array],
    wavelength: Array,
    first_row: int,
    columns: int,
) -> MitsubaObject:
    """Rays through points (u, v) of each pixel and of the pupil; rows of the picture from ``first_row`` on."""
    mi, film = mitsuba(), scene.sensor.film()
    height = float(film.crop_size()[1])
    offset = float(film.crop_offset()[1]) - scene.view.crop_offset[1]
    row = mi.Float(pixel // columns) + drjit().opaque(mi.Float, first_row - offset)
    column = mi.Float(pixel % columns)
    place = mi.Point2f((column + points[0]) / columns, (row + points[1]) / height)
    pupil = mi.Point2f(points[2], points[3])
    ray, _ = scene.sensor.sample_ray(0.0, wavelength, place, pupil)
    return mi.Ray3f(ray)


def _first_scattering(
    scene: MitsubaObject, ray: MitsubaObject, random: MitsubaObject
) -> MitsubaObject:
    """The first intersection of each ray with a surface that is neither a mirror nor clear."""
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
        found = scene.ray_intersect(ray, active)
        hit = dr.select(active, found, hit)
        bsdf = found.bsdf()
        clear = active & found.is_valid() & ~mi.has_flag(bsdf.flags(), flags.Smooth)
        clear &= mi.has_flag(bsdf.flags(), flags.Delta) & (bounce < MOST_BOUNCES)
        choice = random.next_float32()
        direction = mi.Point2f(random.next_float32(), random.next_float32())
        sample, _ = bsdf.sample(context, found, choice, direction, clear)
        ray = dr.select(clear, found.spawn_ray(found.to_world(sample.wo)), ray)
        return clear, bounce + 1, ray, random, hit

    start = (mi.Bool(True), mi.UInt32(0), ray, random, dr.zeros(mi.SurfaceInteraction3f))
    labels = ("active", "bounce", "ray", "random", "hit")
    *_, hit = dr.while_loop(start, again, follow, labels=labels)
    return hit


def _reflectances(
    hit: MitsubaObject, valid: Array, wavelengths_nm: Float64Array
) -> list[Array]:
    """Mean diffuse reflectance at four wavelengths of each filter; 1 without a diffuse part, and on the shapes of
    emitters.

    The filters are a loop, so that the code of every material is compiled once, and their wavelengths are data of the
    kernel, because they follow from the rendered light and are others in every render.
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
