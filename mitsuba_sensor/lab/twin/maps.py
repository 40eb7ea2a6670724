"""Measured maps of a gain setting, by the names that exposing frames knows.

What averaging left of temporal noise widens a measured map. Each part (rows, columns, pixels) is scaled down to its σ
without that noise: the spread is right, and the share of the noise in it stays.
"""

from __future__ import annotations

import numpy as np

from ...core.types import Float64Array
from .combined_map import scaled_to
from .gain_map import GainMap
from .setting import Setting, assembled

SMALLEST_GAIN = 1e-3
"""Gain of a pixel in the map: dead pixels have none."""


def maps_of(setting: Setting) -> dict[str, Float64Array]:
    """``prnu``, ``prnu_col``, offsets in electrons, ``dark_fpn``, and ``read_noise`` where pixels differ."""
    gain = setting.gain.quantity.value
    maps: dict[str, Float64Array] = {}
    for name, part in setting.dark.offsets.parts().items():
        maps[f"dsnu_{name}_e"] = part / gain
    if setting.gains:
        maps |= _gain_maps(setting)
    if setting.dark.rates is not None and setting.dark.cv.known:
        maps["dark_fpn"] = _relative_rates(setting)
    noise = setting.noise
    if noise.pixels is not None:
        maps["read_noise"] = noise.pixels * setting.electrons(noise.read).quantity.value
    if setting.telegraph is not None:
        maps["rts_site"] = setting.telegraph.site
    return maps


def _gain_maps(setting: Setting) -> dict[str, Float64Array]:
    """Gains of the pixels and of the columns.

    Columns of a mosaic differ by filter and have no map of their own: theirs are part of the pixels' map.
    """
    columns = np.zeros((1, setting.shape[1]))
    if not setting.tile:
        columns = setting.gains[""].parts["col"]

    def pixels(gains: GainMap) -> Float64Array:
        rest = gains.parts["pixel"] + gains.parts["row"]
        if setting.tile:
            return rest + gains.parts["col"]
        return rest

    prnu = np.maximum(1 + assembled(setting, pixels), SMALLEST_GAIN)
    return {"prnu": prnu, "prnu_col": 1 + columns}


def _relative_rates(setting: Setting) -> Float64Array:
    """Dark current over its mean, without what telegraph signals add."""
    assert setting.dark.rates is not None
    image = setting.dark.rates.image
    if setting.telegraph is not None:
        image = image - setting.telegraph.mean
    mean = float(image.mean())
    deviations = scaled_to(image - mean, setting.dark.cv.quantity.value * mean)
    factors = np.maximum(1 + deviations / mean, 0.0)
    return np.asarray(factors / factors.mean())
