"""8-bit preview of a raw frame: black level subtracted, white level to 1, demosaiced, sRGB curve.

Nothing is stretched unless asked for: an exposure that is too dark looks too dark.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.units import BOLTZMANN_J_PER_K, photon_energy_j
from ..sensor.camera import Camera
from ..sensor.stage import converter_of

DAYLIGHT_K = 6504.0  # correlated colour temperature of CIE D65, the white of sRGB
NEAR, CORNER = 2.0, 1.0  # bilinear weights of the four neighbours beside and across


def preview(digital: NDArray[np.generic], camera: Camera, gain: float = 1.0) -> NDArray[np.uint8]:
    """One raw frame (H, W) in DN → (H, W) grey or (H, W, 3) colour, 8 bit.

    White is the largest code, or 1/``gain`` of it for a picture that is pushed; colours are balanced so that a grey
    surface in daylight looks grey.
    """
    black_dn, white_dn = converter_of(camera.stages).black_level_dn, 2.0**camera.adc.bits - 1.0
    linear = np.clip(gain * (np.asarray(digital, dtype=np.float64) - black_dn) / (white_dn - black_dn), 0.0, 1.0)
    order = colour_order(camera.filter_names)
    if order is not None:
        planes = demosaic(linear, camera.filter_index(digital.shape), len(camera.filter_names))
        linear = np.clip(planes[..., order] * white_balance(camera)[order], 0.0, 1.0)
    return np.rint(255.0 * srgb_curve(linear)).astype(np.uint8)


def colour_order(filter_names: tuple[str, ...]) -> list[int] | None:
    """Which filter is red, green, blue; None when the camera is not of that kind and its preview stays grey."""
    initials = [name[:1].lower() for name in filter_names]
    return [initials.index(one) for one in "rgb"] if {*"rgb"} <= {*initials} else None


def demosaic(mosaic: NDArray[np.float64], filters: NDArray[np.integer], count: int) -> NDArray[np.float64]:
    """Bilinear: every pixel keeps what it measured and takes the weighted mean of its neighbours for the rest.

    mosaic, filters : (H, W), value and filter number of each pixel; count : F, how many filters → (H, W, F).
    """
    planes = []
    for own in (filters == index for index in range(count)):
        weight = _spread(own.astype(float))
        mean = np.divide(_spread(np.where(own, mosaic, 0.0)), weight, out=np.zeros_like(mosaic), where=weight > 0)
        planes.append(np.where(own, mosaic, mean))
    return np.stack(planes, axis=-1)


def white_balance(camera: Camera) -> NDArray[np.float64]:
    """(F,) factors ≥ 1 that make the filters equal under daylight."""
    wavelengths_nm = np.linspace(*camera.band_nm, 256)
    electrons: NDArray[np.float64] = (camera.qe(wavelengths_nm) * daylight_photons(wavelengths_nm)).sum(axis=-1)
    return np.asarray(electrons.max() / electrons)


def daylight_photons(wavelengths_nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Photons per wavelength of a black body at the colour temperature of daylight, in any unit (Planck)."""
    energy_over_kt = photon_energy_j(wavelengths_nm) / (BOLTZMANN_J_PER_K * DAYLIGHT_K)
    return np.asarray(wavelengths_nm**-4.0 / np.expm1(energy_over_kt))


def srgb_curve(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1 transfer curve, [0, 1] → [0, 1]."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def _spread(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over the eight neighbours with the bilinear weights, zero outside the image."""
    padded, total, (height, width) = np.pad(image, 1), np.zeros_like(image), image.shape
    for down, right in np.ndindex(3, 3):
        weight = (0.0, NEAR, CORNER)[abs(down - 1) + abs(right - 1)]
        total += weight * padded[down : down + height, right : right + width]
    return total
