"""Pictures of charts that pixels average exactly, in closed form, for the instruments of image quality."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def slanted_edge(
    shape: tuple[int, int], angle_deg: float, offset_px: float = 0.0, dark: float = 0.1
) -> Array:
    """An edge that full pixels average, between ``dark`` and 1.  angle_deg : of its normal from the rows."""
    rows, columns = shape
    angle = math.radians(angle_deg)
    x, y = np.arange(columns) + 0.5 - columns / 2, np.arange(rows) + 0.5 - rows / 2
    distance = x * math.cos(angle) + y[:, None] * math.sin(angle) + offset_px
    longer, shorter = sorted((abs(math.cos(angle)), abs(math.sin(angle))), reverse=True)
    if shorter < 1e-9:
        share = np.clip(distance + 0.5, 0.0, 1.0)
    else:
        share = _integrated(distance, longer, shorter)
    return np.asarray(dark + (1 - dark) * share)


def _integrated(distance: Array, longer: float, shorter: float) -> Array:
    """Integral up to a distance of a trapezoid whose area is 1."""

    def half_square(end: float) -> Array:
        return np.asarray(np.square(np.maximum(distance + end, 0.0)) / 2)

    outer, inner = (longer + shorter) / 2, (longer - shorter) / 2
    whole = half_square(outer) - half_square(inner) - half_square(-inner) + half_square(-outer)
    return np.asarray(whole / (longer * shorter))


def pixel_modulation(frequency: Array, angle_deg: float) -> Array:
    """Modulation of a full pixel along a direction."""
    angle = math.radians(angle_deg)
    across = np.sinc(frequency * math.cos(angle)) * np.sinc(frequency * math.sin(angle))
    return np.asarray(np.abs(across))
