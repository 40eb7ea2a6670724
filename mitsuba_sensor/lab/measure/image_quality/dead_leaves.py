"""Texture MTF of a dead-leaves chart without noise, with its 95 % band.

The spectrum of the image is compared with the spectrum of the known chart in overlapping tiles (Welch). ``"cross"``
uses their product (Kirk et al. 2014), in which noise and artefacts cancel; the image must be aligned with the chart to
a fraction of a pixel. ``"power"`` uses the power of the image over the power of the chart (Cao et al. 2010, ISO
19567-2), from products of different frames, which share no temporal noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....core import InputError, finite_numbers, require
from ....core.errors import shown
from ....core.types import Float64Array
from ...quantity import student_interval
from .modulation import Modulation, OfModulation, picture_of

SECTIONS = {"cross": "Kirk et al. 2014", "power": "ISO 19567-2"}
TILE_PX = 64
TILE_MIN_PX = 32
TILES_MIN = 4
"""Smallest number of tiles along the shorter side, half a tile apart."""


@dataclass(frozen=True, eq=False)
class DeadLeaves(OfModulation):
    """Texture MTF.

    modulation : versus frequency, averaged over all directions.
    """


class _Tiles(NamedTuple):
    """Sums of the products of image and chart, and of the chart's power, in each tile and ring of frequencies.

    frequency : mean frequency of the chart's power in each ring [cycles per sample].
    """

    product: NDArray[np.complex128]
    power: Float64Array
    frequency: Float64Array


def dead_leaves(
    frames: ArrayLike,
    chart: ArrayLike,
    *,
    method: str = "cross",
    sample_px: float = 1.0,
) -> DeadLeaves:
    """Measure the texture MTF in frames of a known random pattern.

    ::

        chart = np.random.default_rng(3).random((192, 192))
        blurred = (chart + np.roll(chart, 1, axis=1)) / 2
        print(ms.lab.dead_leaves(100 + 900 * blurred, 100 + 900 * chart).modulation.at(0.25))

    frames : linear values without the black level, shape (H, W) or (N, H, W); at least two frames for "power".
    chart : brightness of the chart on the same pixels, up to a factor, shape (H, W); or (k·H, k·W) with points k times
        as dense, so the MTF includes the pixel's aperture.
    method : "cross", or "power" if the image is not aligned with the chart to a tenth of a pixel.
    sample_px : distance of neighbouring values [px], 2 for one plane of a Bayer mosaic.
    Raises InputError for images of another size than the chart, and for images that are too small.
    """
    wanted = "values (rows, columns) or (frames, rows, columns)"
    pictures = finite_numbers("frames", frames, wanted)
    if pictures.ndim == 2:
        pictures = pictures[None]
    if pictures.ndim != 3 or not pictures.size:
        raise InputError(f"frames has shape {pictures.shape}; pass {wanted}.")
    if not isinstance(method, str) or method not in SECTIONS:
        raise InputError(f"method is {shown(method)}; it must be one of {', '.join(SECTIONS)}.")
    if method == "power" and len(pictures) < 2:
        raise InputError(
            'frames has one frame, whose noise cannot be separated; pass at least two, or method="cross".'
        )
    sample_px = require(
        "sample_px", sample_px, 0.01, 100.0, "pixels, 2 for a plane of a mosaic"
    )
    reference = picture_of(chart, "chart")
    size = _tile_size(pictures.shape[1:], reference.shape)
    if not (pictures.mean() > 0 and np.ptp(reference) > 0 and reference.mean() > 0):
        raise InputError("frames or chart have no texture; pass brightness above 0.")
    pictures = pictures / pictures.mean()
    tiles = _cross(pictures, reference / reference.mean(), size, method)
    return DeadLeaves(_modulation(tiles, tiles.frequency / sample_px, method))


def _tile_size(shape: tuple[int, ...], chart: tuple[int, ...]) -> int:
    """Return the side of a tile [samples]. Raises InputError if chart and image do not match."""
    dense = chart[0] // shape[0]
    if dense < 1 or chart != (dense * shape[0], dense * shape[1]):
        raise InputError(
            f"chart has shape {chart} and frames {shape}; pass a chart of this shape, or of a multiple of it."
        )
    size = min(TILE_PX, 2 * (min(shape) // (TILES_MIN + 1)))
    if size < TILE_MIN_PX:
        least = TILE_MIN_PX // 2 * (TILES_MIN + 1)
        raise InputError(
            f"frames have {shape[0]} × {shape[1]} pixels; pass {least} × {least} or more."
        )
    return size


def _cross(pictures: Float64Array, reference: Float64Array, size: int, method: str) -> _Tiles:
    """Return sums over rings of the products of the spectra, for each tile."""
    dense = reference.shape[0] // pictures.shape[1]
    frequency = np.fft.fftfreq(size)
    distance = np.hypot(frequency, frequency[:, None])
    ring = np.rint(distance * size).astype(int).ravel()
    shift = np.exp(1j * np.pi * (1 - 1 / dense) * (frequency + frequency[:, None]))
    products, powers, moments = [], [], []
    for top in range(0, pictures.shape[1] - size + 1, size // 2):
        for left in range(0, pictures.shape[2] - size + 1, size // 2):
            parts = pictures[:, top : top + size, left : left + size]
            spectra = _spectra(parts, size)
            fine = (
                slice(top * dense, (top + size) * dense),
                slice(left * dense, (left + size) * dense),
            )
            of_chart = shift * _spectra(reference[None, *fine], size)[0] / dense**2
            power = np.square(np.abs(of_chart))
            product = spectra.mean(axis=0) * of_chart.conj()
            if method == "power":
                total, count = spectra.sum(axis=0), len(spectra)
                alone = np.square(np.abs(spectra)).sum(axis=0)
                product = (np.square(np.abs(total)) - alone) / (count * (count - 1)) + 0j
            products.append(_ring_sums(product, ring, size))
            powers.append(_ring_sums(power + 0j, ring, size).real)
            moments.append(_ring_sums(power * distance + 0j, ring, size).real)
    power_by_ring = np.sum(powers, axis=0)
    middle = _seen_frequency(np.sum(moments, axis=0) / power_by_ring, power_by_ring, size)
    return _Tiles(np.array(products), np.array(powers), middle)


def _seen_frequency(middle: Float64Array, power: Float64Array, size: int) -> Float64Array:
    """Return the mean frequency that a windowed tile sees, which is lower if the chart's power falls steeply.

    The window has a spread of 1/(√3·size); the power at one frequency is the power of a ring over its circumference.
    """
    slope = np.gradient(np.log(power / middle), middle)
    return np.asarray(middle + slope / (3 * size**2))


def _spectra(parts: Float64Array, size: int) -> NDArray[np.complex128]:
    """Return the spectra of windowed tiles (N, …), up to the frequencies of a tile of ``size`` samples."""
    side = parts.shape[1]
    window = np.sin(np.pi * (np.arange(side) + 0.5) / side) ** 2
    window = window[:, None] * window
    level = (parts * window).sum(axis=(1, 2)) / window.sum()
    spectra = np.fft.fft2((parts - level[:, None, None]) * window)
    kept = np.rint(np.fft.fftfreq(size) * size).astype(int)
    return np.asarray(spectra[:, kept[:, None], kept])


def _ring_sums(
    values: NDArray[np.complex128], ring: NDArray[np.intp], size: int
) -> NDArray[np.complex128]:
    """Return sums over rings of 1, 2, … waves in a tile, slightly above the Nyquist frequency."""
    flat = values.ravel()
    parts = [np.bincount(ring, part) for part in (flat.real, flat.imag)]
    return np.asarray((parts[0] + 1j * parts[1])[1 : size // 2 + 2])


def _modulation(tiles: _Tiles, frequency: Float64Array, method: str) -> Modulation:
    """Return the ratio of the sums over all tiles, with errors from the scatter of the tiles."""
    count = len(tiles.power)
    total = tiles.power.sum(axis=0)
    ratio = tiles.product.sum(axis=0) / total
    phase = ratio / np.maximum(np.abs(ratio), 1e-12)
    rest = (tiles.product - ratio * tiles.power) * phase.conj()
    scale = np.sqrt(count / (count - 1)) / total
    along = scale * np.sqrt(np.square(rest.real).sum(axis=0))
    across = scale * np.sqrt(np.square(rest.imag).sum(axis=0))
    curves = []
    for size, radial, tangential in zip(np.abs(ratio), along, across, strict=True):
        value, low, high = student_interval(float(size), float(radial), count - 1)
        if method == "power":
            curves.append(np.sqrt(np.maximum([value, low, high], 0.0)))
        else:
            centre = np.sqrt(max(value**2 - tangential**2, 0.0))
            curves.append(
                np.maximum([centre, low + centre - value, high + centre - value], 0.0)
            )
    value, low, high = np.array(curves).T
    return Modulation(frequency, value, low, high, SECTIONS[method])
