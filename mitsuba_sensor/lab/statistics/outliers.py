"""Outlying pixels of an image (hot, dead, stuck), which a standard deviation must not depend on."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core.types import Float64Array
from .estimators import z_limit

FALSE_ALARM = 0.01
"""Probability of one or more outliers in an image of normal values."""
TAIL_SHARE = 0.01
"""Fraction of the pixels outside the quantile that gives the width of the tail; more pixels are a distribution, not
outliers."""
ROUNDING_DN = 12**-0.5
"""Standard deviation of rounding to whole numbers."""
Pixels = NDArray[np.bool_]


def outliers(image: Float64Array, least_sigma: float = ROUNDING_DN) -> Pixels:
    """Return a mask of the pixels of an image (H, W) that neither a normal nor a longer-tailed distribution explains.

    The medians of rows and columns are subtracted. The limit applies to normal values, with the larger σ from the
    median and from the 99 % quantile of the distances, so the tail of a log-normal dark current has no outliers.

    least_sigma : smallest σ in the unit of the image; pixels that differ by a code are no outliers.
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
    """Return the distance from the mean that contains this fraction of normal values of σ = 1."""
    return float(scipy.special.ndtri((1 + share) / 2))


def fill(image: Float64Array, left_out: Pixels) -> Float64Array:
    """Return the image with these pixels filled from the means of their rows and columns."""
    if not left_out.any():
        return image
    kept = np.ma.array(image, mask=left_out)
    mean = float(kept.mean())
    rows = kept.mean(axis=1, keepdims=True).filled(mean)
    columns = kept.mean(axis=0, keepdims=True).filled(mean)
    return np.where(left_out, rows + columns - mean, image)


def note_left_out_pixels(left_out: Pixels) -> str:
    """Return a note on the number of outliers, or an empty text."""
    count = int(np.count_nonzero(left_out))
    if not count:
        return ""
    return f"without {count} outlying pixel{'s' * (count > 1)} ({count / left_out.size:.2g} of all)"
