"""What each pixel has behind its own colour filter: the values of that filter, and the factor of its bands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array

FACTORS = (0.0, 1e3)
"""A band frees at most so many times the electrons of a flat spectrum; beyond it is rounding."""


def of_own_filter(
    per_filter: NDArray[np.floating], tile: NDArray[np.integer], origin: tuple[int, int]
) -> Float64Array:
    """(H, W, F), or (H, W, 1) for all filters, as each pixel's own filter has it, (H, W).

    tile : filter numbers that repeat over the sensor.  origin : (row, column) of the first pixel on it.
    """
    if per_filter.shape[2] == 1:
        return np.asarray(per_filter[..., 0], np.float64)
    found, (down, right) = np.empty(per_filter.shape[:2]), tile.shape
    for row, column in np.ndindex(tile.shape):
        here = (
            slice((row - origin[0]) % down, None, down),
            slice((column - origin[1]) % right, None, right),
        )
        found[here] = per_filter[*here, tile[row, column]]
    return found


def in_band_factor(
    electrons: NDArray[np.floating], bands: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Photoelectrons over those of the bands with a flat spectrum in each, (H, W); 1 where that is no number."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = electrons / bands
    return np.where(np.isfinite(factor), np.clip(factor, *FACTORS), 1.0).astype(np.float32)
