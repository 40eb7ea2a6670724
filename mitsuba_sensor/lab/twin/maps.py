"""Measured maps of a gain setting, by the names that exposing frames knows.

What averaging left of temporal noise widens a measured map. Each part (rows, columns, pixels) is scaled down to its σ
without that noise: the spread is right, and the share of the noise in it stays.
"""

from __future__ import annotations

import numpy as np

from ...core.types import Float64Array
from .combined_map import scaled_to
from .setting import Setting, assembled

SMALLEST_GAIN = 1e-3
"""Of a pixel in the map: dead pixels have none."""


def maps_of(one: Setting) -> dict[str, Float64Array]:
    """``prnu``, ``prnu_col``, offsets in electrons, ``dark_fpn``, and ``read_noise`` where pixels differ."""
    gain = one.gain.quantity.value
    parts = one.dark.offsets.parts()
    found = {f"dsnu_{name}_e": part / gain for name, part in parts.items()}
    if one.gains:
        shared = one.gains[""].parts["col"] if not one.tile else None
        found["prnu"] = np.maximum(
            1 + assembled(one, lambda g: _of_pixels(g.parts, shared is not None)), SMALLEST_GAIN
        )
        found["prnu_col"] = 1 + (np.zeros((1, one.shape[1])) if shared is None else shared)
    if one.dark.rates is not None and one.dark.cv.known:
        found["dark_fpn"] = _rates(one)
    if one.noise.pixels is not None:
        found["read_noise"] = one.noise.pixels * one.electrons(one.noise.read).quantity.value
    if one.telegraph is not None:
        found["rts_site"] = one.telegraph.site
    return found


def _of_pixels(parts: dict[str, Float64Array], columns_apart: bool) -> Float64Array:
    """Pixels and rows; columns too where they are no map of their own, since those of a mosaic differ by filter."""
    return parts["pixel"] + parts["row"] + (0.0 if columns_apart else parts["col"])


def _rates(one: Setting) -> Float64Array:
    """Dark current over its mean, without what telegraph signals add."""
    assert one.dark.rates is not None
    image = one.dark.rates.image - (0.0 if one.telegraph is None else one.telegraph.mean)
    mean = float(image.mean())
    factors = np.maximum(
        1 + scaled_to(image - mean, one.dark.cv.quantity.value * mean) / mean, 0.0
    )
    return np.asarray(factors / factors.mean())
