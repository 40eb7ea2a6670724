"""A response y = s(1 + κs), and the linear signal s that it came from."""

from __future__ import annotations

import numpy as np

from ...core.types import Float64Array


def straight(signal: Float64Array, curvature: float) -> Float64Array:
    """s of y; signals beyond the vertex are taken to be at it.  signal, curvature : y [DN], κ [1/DN]."""
    if not curvature:
        return signal
    root = np.sqrt(np.maximum(1 + 4 * curvature * signal, 1e-9))
    return np.asarray((root - 1) / (2 * curvature))
