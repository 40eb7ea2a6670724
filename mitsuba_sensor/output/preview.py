"""8-bit preview of a raw frame: black level subtracted, white level to 1, demosaiced, colours of the scene, sRGB curve.

Nothing is stretched unless asked for: an exposure that is too dark looks too dark.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.illuminant import Illuminant
from ..optics.spectra import srgb_curve
from ..sensor.camera import Camera
from ..sensor.colour_matrix import ColourMatrix, colour_matrix, colour_order
from ..sensor.stage import converter_of
from .demosaic import demosaic_bayer

NEAR, CORNER = 2.0, 1.0  # bilinear weights of the four neighbours beside and across
PIXELS_AT_ONCE = 2**17  # of a frame that is developed: some twenty float64 maps of them
HALO_ROWS = 16  # beyond them no pixel matters: demosaicing looks at fewer than ten, edges refined
BAYER = 2  # rows and columns of a tile of two greens, and of the smallest picture that has one


def preview(
    digital: NDArray[np.generic],
    camera: Camera,
    gain: float = 1.0,
    origin: tuple[int, int] = (0, 0),
    illuminant: Illuminant | None = None,
) -> NDArray[np.uint8]:
    """One raw frame (H, W) in DN → (H, W) grey or (H, W, 3) colour, 8 bit.

    origin : row and column of its first pixel on the sensor, from which its colour filters follow.
    illuminant : of the scene; daylight where it is not known. A white surface under it is white.
    White is the largest code, or 1/``gain`` of it for a picture that is pushed.
    """
    return developed(digital, camera, colour_matrix(camera, illuminant), gain, origin)


def developed(
    digital: NDArray[np.generic],
    camera: Camera,
    colours: ColourMatrix | None,
    gain: float = 1.0,
    origin: tuple[int, int] = (0, 0),
) -> NDArray[np.uint8]:
    """The same with a matrix that is known; grey where there is none."""
    (height, width), parts = digital.shape, []
    step = max(PIXELS_AT_ONCE // width, 1)
    for first in range(0, height, step):
        top, last = max(first - HALO_ROWS, 0), min(first + step, height)
        here = origin[0] + top, origin[1]
        near = _developed(digital[top : last + HALO_ROWS], camera, colours, gain, here)
        parts.append(near[first - top : last - top])
    return np.concatenate(parts)


def _developed(
    digital: NDArray[np.generic], camera: Camera, colours: ColourMatrix | None, gain: float, origin: tuple[int, int]
) -> NDArray[np.uint8]:
    black_dn, white_dn = converter_of(camera.stages).black_level_dn, 2.0**camera.adc.bits - 1.0
    linear = (np.asarray(digital, dtype=np.float64) - black_dn) / (white_dn - black_dn)
    if colours is not None:
        filters = camera.filter_index(linear.shape, origin)
        balanced = np.minimum(colours.white_balance * demosaic(linear, filters, camera), 1.0)
        linear = balanced @ colours.to_srgb.T
        linear[(balanced[..., colour_order(camera.filter_names)] >= 1).all(axis=-1)] = 1.0  # saturation is white
    return np.rint(255.0 * srgb_curve(np.clip(gain * linear, 0.0, 1.0))).astype(np.uint8)


def demosaic(mosaic: NDArray[np.float64], filters: NDArray[np.integer], camera: Camera) -> NDArray[np.float64]:
    """(H, W) values and filter numbers → (H, W, F): by Menon, Andriani and Calvagno 2007 behind a Bayer pattern (the
    edges that it follows stay without colour), else by bilinear means."""
    names = "".join(camera.filter_names[number][:1].upper() for number in filters[:BAYER, :BAYER].ravel())
    if (
        sorted(names) != ["B", "G", "G", "R"]
        or len(camera.filter_names) != 3
        or np.shape(camera.tile) != (BAYER, BAYER)
    ):
        return bilinear(mosaic, filters, len(camera.filter_names))
    order = [name[:1].upper() for name in camera.filter_names]
    red, blue = (filters == order.index(name) for name in "RB")
    return demosaic_bayer(mosaic, red, blue)[..., ["RGB".index(name) for name in order]]


def bilinear(mosaic: NDArray[np.float64], filters: NDArray[np.integer], count: int) -> NDArray[np.float64]:
    """Every pixel keeps what it measured and takes the weighted mean of its neighbours for the rest.

    mosaic, filters : (H, W), value and filter number of each pixel; count : F, how many filters → (H, W, F).
    """
    planes = []
    for own in (filters == index for index in range(count)):
        weight = _spread(own.astype(float))
        mean = np.divide(_spread(np.where(own, mosaic, 0.0)), weight, out=np.zeros_like(mosaic), where=weight > 0)
        planes.append(np.where(own, mosaic, mean))
    return np.stack(planes, axis=-1)


def _spread(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over the eight neighbours with the bilinear weights, zero outside the image."""
    padded, total, (height, width) = np.pad(image, 1), np.zeros_like(image), image.shape
    for down, right in np.ndindex(3, 3):
        weight = (0.0, NEAR, CORNER)[abs(down - 1) + abs(right - 1)]
        total += weight * padded[down : down + height, right : right + width]
    return total
