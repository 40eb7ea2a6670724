"""High-pass filter against uneven light, and the share of independent rows, columns and pixels that it leaves."""

from __future__ import annotations

import numpy as np
import scipy

from ..core import InputError
from ..core.types import Float64Array

KERNEL = np.convolve(np.convolve(np.full(7, 1 / 7), np.full(11, 1 / 11)), (0.25, 0.5, 0.25))
"""Along one axis: boxes of 7 and 11 pixels and a binomial of 3, which are smoothed with and subtracted (EMVA 1288 R4
8.1)."""
MARGIN = len(KERNEL) // 2
"""Pixels at each border whose neighbourhood is not complete."""


def highpass(image: Float64Array) -> Float64Array:
    """The image less its smooth part, without a margin of 9 pixels, (H, W) → (H − 18, W − 18).

    Raises InputError for an image of fewer than 38 rows or columns, half of which would be margin.
    """
    if min(image.shape) < 4 * MARGIN + 2:
        raise InputError(
            f"the image is {image.shape[0]} × {image.shape[1]}; the high-pass filter needs at least "
            f"{4 * MARGIN + 2} rows and columns. Leave high_pass out."
        )
    smooth = image
    for axis in (0, 1):
        smooth = scipy.ndimage.convolve1d(smooth, KERNEL, axis=axis, mode="reflect")
    inside = (slice(MARGIN, -MARGIN),) * 2
    return np.asarray(image[inside] - smooth[inside])


def highpass_power() -> tuple[float, float, float]:
    """Share of the variance that is left of independent rows, columns and pixels."""
    centre, power = KERNEL[MARGIN], float(KERNEL @ KERNEL)
    line, pixel = 1 - 2 * centre + power, 1 - 2 * centre**2 + power**2
    return line, line, pixel
