"""Texture modulation transfer of a dead-leaves chart, with its 95 % band; noise is not in it.

The spectrum of the picture is compared with that of the chart itself, which is known, in overlapping tiles (Welch).
``"cross"``: their product (Kirk et al. 2014): what is not of the chart, noise and artefacts, has no part in it. The
picture must lie on the chart within a fraction of a pixel. ``"power"``: the power of the picture over that of the chart
(Cao et al. 2010, ISO 19567-2), from products of different frames, which have no temporal noise in common.
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
SMALLEST_TILE_PX = 32
FEWEST_TILES = 4
"""Side by side along the shorter side, half a tile apart."""


@dataclass(frozen=True, eq=False)
class DeadLeaves(OfModulation):
    """Modulation transfer of texture.

    modulation : over the frequency in any direction.
    """


class _Tiles(NamedTuple):
    """Of every tile and ring of frequencies: sums of the products of picture and chart, and of the chart's power.

    frequency : mean of the chart's power in each ring [cycles per sample].
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
    """Modulation transfer of texture: of frames of a random pattern whose picture is known.

    ::

        chart = np.random.default_rng(3).random((192, 192))
        blurred = (chart + np.roll(chart, 1, axis=1)) / 2
        print(ms.lab.dead_leaves(100 + 900 * blurred, 100 + 900 * chart).modulation.at(0.25))

    frames : (H, W) or (N, H, W) linear values without the black level; two frames or more for "power".
    chart : (H, W), the brightness of the chart on the same pixels, up to a factor; or (k·H, k·W) of points k times as
        dense: then the pixel's aperture is in the modulation.
    method : "cross", or "power" where the picture does not lie on the chart to a tenth of a pixel.
    sample_px : distance of neighbouring values, 2 for one plane of a Bayer mosaic.
    Raises InputError for pictures of another size than the chart, and for those that are too small.
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
            'one frame shows no noise apart from the texture; pass two frames or more, or method="cross".'
        )
    sample_px = require(
        "sample_px", sample_px, 0.01, 100.0, "pixels, 2 for a plane of a mosaic"
    )
    reference = picture_of(chart, "chart")
    size = _tile_size(pictures.shape[1:], reference.shape)
    if not (pictures.mean() > 0 and np.ptp(reference) > 0 and reference.mean() > 0):
        raise InputError("frames or chart show no texture; pass brightness above 0.")
    pictures = pictures / pictures.mean()
    tiles = _cross(pictures, reference / reference.mean(), size, method)
    return DeadLeaves(_modulation(tiles, tiles.frequency / sample_px, method))


def _tile_size(shape: tuple[int, ...], chart: tuple[int, ...]) -> int:
    """Side of a tile [samples]; raises InputError where chart and picture do not fit."""
    dense = chart[0] // shape[0]
    if dense < 1 or chart != (dense * shape[0], dense * shape[1]):
        raise InputError(
            f"chart has shape {chart} and frames {shape}; pass a chart of that shape, or a whole number of times it."
        )
    size = min(TILE_PX, 2 * (min(shape) // (FEWEST_TILES + 1)))
    if size < SMALLEST_TILE_PX:
        least = SMALLEST_TILE_PX // 2 * (FEWEST_TILES + 1)
        raise InputError(
            f"frames have {shape[0]} × {shape[1]} pixels; pass {least} × {least} or more."
        )
    return size


def _cross(pictures: Float64Array, reference: Float64Array, size: int, method: str) -> _Tiles:
    """Sums over rings of the products of the spectra, tile by tile."""
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
            own = shift * _spectra(reference[None, *fine], size)[0] / dense**2
            power = np.square(np.abs(own))
            product = spectra.mean(axis=0) * own.conj()
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
    """Mean of the frequencies that a windowed tile mixes, which is lower where the chart's power falls steeply.

    The window has a spread of 1/(√3·size); the power at one frequency is that of a ring over its circumference.
    """
    slope = np.gradient(np.log(power / middle), middle)
    return np.asarray(middle + slope / (3 * size**2))


def _spectra(parts: Float64Array, size: int) -> NDArray[np.complex128]:
    """Spectra of windowed tiles (N, …), up to the frequencies of a tile of ``size`` samples."""
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
    """Sums over the frequencies of 1, 2, … waves in a tile, a little beyond Nyquist's."""
    flat = values.ravel()
    parts = [np.bincount(ring, part) for part in (flat.real, flat.imag)]
    return np.asarray((parts[0] + 1j * parts[1])[1 : size // 2 + 2])


def _modulation(tiles: _Tiles, frequency: Float64Array, method: str) -> Modulation:
    """The ratio of the sums over all tiles; its error is from the scatter of the tiles about it."""
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
