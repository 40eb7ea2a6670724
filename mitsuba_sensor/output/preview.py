"""8-bit preview of a raw frame: black level subtracted, white level at 1, demosaiced, colours of the scene, sRGB curve.

The brightness is not stretched unless requested: an underexposed frame looks dark.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..camera.colour_matrix import ColourMatrix, colour_matrix, colour_order
from ..camera.figures import saturation_dn
from ..core import Float64Array
from ..core.signals import Illuminant
from ..optics.spectra import srgb_curve
from ..stages.stage import converter_of
from .demosaic import bilinear, demosaic

PIXELS_AT_ONCE = 2**17
"""Pixels that are developed together, which takes twenty float64 maps."""
BRIGHT_PERCENTILE, BRIGHT_LEVEL = 95.0, 0.5
"""A picture is brightened until this percentile of its pixels would exceed this fraction of white."""
HALO_ROWS = 16
"""Rows that affect a pixel: demosaicing uses fewer than ten."""


def preview(
    digital: NDArray[np.generic],
    camera: Camera,
    gain: float = 1.0,
    origin: tuple[int, int] = (0, 0),
    illuminant: Illuminant | None = None,
) -> NDArray[np.uint8]:
    """Return a raw frame (H, W) [DN] as 8-bit grey (H, W) or colour (H, W, 3).

    origin : row and column of the first pixel on the sensor, which determine the colour filters.
    illuminant : illuminant of the scene, under which a white surface is white. Default: daylight.
    White is the full-scale code divided by ``gain``. Clipped highlights become white.
    """
    return developed(digital, camera, colour_matrix(camera, illuminant), gain, origin)


def developed(
    digital: NDArray[np.generic],
    camera: Camera,
    colours: ColourMatrix | None,
    gain: float = 1.0,
    origin: tuple[int, int] = (0, 0),
) -> NDArray[np.uint8]:
    """Return the picture of :func:`preview` with a given colour matrix; grey without one."""
    (height, width), parts = digital.shape, []
    step = max(PIXELS_AT_ONCE // width, 1)
    for first in range(0, height, step):
        top, last = max(first - HALO_ROWS, 0), min(first + step, height)
        strip_origin = origin[0] + top, origin[1]
        strip = digital[top : last + HALO_ROWS]
        picture = _develop_strip(strip, camera, colours, gain, strip_origin)
        parts.append(picture[first - top : last - top])
    return np.concatenate(parts)


def brightening(digital: NDArray[np.generic], camera: Camera) -> int:
    """Return the power of two by which a raw frame (H, W) must be brightened to look well exposed, or 1."""
    converter = converter_of(camera.stages)
    swing_dn = converter.highest - converter.black_level_dn
    bright_code = float(np.percentile(np.asarray(digital, np.float64), BRIGHT_PERCENTILE))
    bright_dn = bright_code - converter.black_level_dn
    factor = BRIGHT_LEVEL * swing_dn / max(bright_dn, 1.0)
    return int(2 ** math.floor(math.log2(min(max(factor, 1.0), max(swing_dn, 1.0)))))


def _develop_strip(
    digital: NDArray[np.generic],
    camera: Camera,
    colours: ColourMatrix | None,
    gain: float,
    origin: tuple[int, int],
) -> NDArray[np.uint8]:
    """Develop some rows of a frame."""
    black_dn, white_dn = camera.black_level_dn, 2.0**camera.code_bits - 1.0
    range_dn = max(white_dn - black_dn, 1.0)
    linear = (np.asarray(digital, dtype=np.float64) - black_dn) / range_dn
    if colours is not None:
        clip = min((saturation_dn(camera) - black_dn) / range_dn, 1.0)
        filters = camera.filter_index(linear.shape, origin)
        balanced = _balance_and_demosaic(linear, filters, camera, colours, clip)
        order = colour_order(camera.filter_names)
        saturated = (balanced[..., order] >= clip).all(axis=-1)
        linear = balanced @ colours.to_srgb.T
        linear[saturated] = clip  # saturated pixels are white
    return np.rint(255.0 * srgb_curve(np.clip(gain * linear, 0.0, 1.0))).astype(np.uint8)


def _balance_and_demosaic(
    linear: Float64Array,
    filters: NDArray[np.integer],
    camera: Camera,
    colours: ColourMatrix,
    clip: float,
) -> Float64Array:
    """Return white-balanced colours (H, W, F) of a mosaic (H, W), clipped where the filter with the least factor clips.

    The mosaic is balanced and clipped before interpolation, so a grey surface has equal values, and saturated filters
    are equally bright.
    """
    mosaic = colours.white_balance[filters] * linear
    clipped = np.minimum(mosaic, clip)
    balanced = np.minimum(demosaic(clipped, filters, camera), clip)
    excess = mosaic - clipped
    if not excess.any():
        return balanced
    order = colour_order(camera.filter_names)
    excesses = bilinear(excess, filters, len(camera.filter_names))[..., order]
    is_clipped = excesses.any(axis=-1)
    with_hue = balanced[is_clipped]
    with_hue[:, order] = np.minimum(_keep_hue(with_hue[:, order], excesses[is_clipped]), clip)
    balanced[is_clipped] = with_hue
    return balanced


def _keep_hue(clipped: Float64Array, excesses: Float64Array) -> Float64Array:
    """Return colours (N, 3) with the mean and chroma of the clipped colours, and the hue of the unclipped colours.

    Otherwise bluish light with clipped blue would become cyan before it becomes white. The highlight reconstruction
    "blend" of dcraw and LibRaw does the same.
    """
    unclipped = clipped + excesses
    mean = clipped.mean(axis=-1, keepdims=True)
    hue = unclipped - unclipped.mean(axis=-1, keepdims=True)
    chroma_clipped = np.linalg.norm(clipped - mean, axis=-1, keepdims=True)
    chroma = np.linalg.norm(hue, axis=-1, keepdims=True)
    ratio = np.divide(chroma_clipped, chroma, out=np.zeros_like(chroma), where=chroma > 0)
    return np.asarray(mean + ratio * hue)
