"""Pixels that stand out from an image: hot, dead and stuck ones, which a standard deviation must not depend on."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.types import Float64Array
from .estimators import z_limit

FALSE_ALARM = 0.01
"""Probability that one pixel or more of an image of normal values is left out."""
TAIL_SHARE = 0.01
"""Share of the pixels that are beyond the quantile from which the width of the tail is known. Above that share, what
stands out is a distribution of its own and no handful of pixels."""
ROUNDING_DN = 12**-0.5
"""Standard deviation of rounding to whole numbers."""
Pixels = NDArray[np.bool_]


def outliers(image: Float64Array, least_sigma: float = ROUNDING_DN) -> Pixels:
    """Pixels of an image (H, W) that neither a normal distribution nor one with a longer tail explains.

    The medians of rows and columns are subtracted. The limit is that of normal values, of which one image in a hundred
    has a pixel beyond it, with σ from the quartiles or from the 99 % quantile of the distances, whichever is larger:
    the tail of a log-normal dark current is part of the image, a hot pixel is not.

    least_sigma : in the unit of the image; few pixels that differ by a code are no defects.
    """
    rest = image - np.median(image)
    for axis in (1, 0):
        if image.shape[axis] > 2:
            rest = rest - np.median(rest, axis=axis, keepdims=True)
    distance = np.abs(rest)
    middle, tail = np.quantile(distance, (0.5, 1 - TAIL_SHARE))
    sigma = max(middle / _normal_quantile(0.5), tail / _normal_quantile(1 - TAIL_SHARE))
    return np.asarray(distance > z_limit(image.size, FALSE_ALARM) * max(sigma, least_sigma))


def _normal_quantile(share: float) -> float:
    """Distance from the mean within which this share of normal values of σ = 1 lies."""
    return float(scipy.special.ndtri((1 + share) / 2))


def fill(image: Float64Array, left_out: Pixels) -> Float64Array:
    """The image with the pixels that are left out as their rows and columns let expect."""
    if not left_out.any():
        return image
    kept = np.ma.array(image, mask=left_out)
    mean = float(kept.mean())
    rows = kept.mean(axis=1, keepdims=True).filled(mean)
    columns = kept.mean(axis=0, keepdims=True).filled(mean)
    return np.where(left_out, rows + columns - mean, image)


def note_left_out_pixels(left_out: Pixels) -> str:
    """How many pixels were left out, or nothing."""
    count = int(np.count_nonzero(left_out))
    if not count:
        return ""
    return f"without {count} pixel{'s' * (count > 1)} that stand{'s' * (count == 1)} out ({count / left_out.size:.2g})"
