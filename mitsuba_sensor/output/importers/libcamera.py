"""Reads tuning files of libcamera for the Raspberry Pi (JSON, version 2): rpi.noise, rpi.black_level, rpi.alsc.

All in a scale of 16 bits (Raspberry Pi Camera Algorithm and Tuning Guide; utils/raspberrypi/ctt/ctt_noise): the
standard deviation of a pixel at gain 1 is reference_constant + reference_slope·√(value above black). Shot noise has
σ² = K·value, so K = reference_slope² [DN16/e-]; the constant is the noise of darkness.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...camera.camera import Camera
from ...core import InputError
from .draft import Draft

SCALE_BITS = 16
GRIDS = {192: (12, 16), 1024: (32, 32)}
"""Length of a table of rpi.alsc → its rows and columns."""
HEIGHTS = 9
"""Image heights of the fall-off, from the axis to the corner."""


def is_tuning(data: object) -> bool:
    """Whether a JSON file is a tuning file."""
    return isinstance(data, dict) and isinstance(data.get("algorithms"), list)


def read_tuning(data: dict[str, Any], file: str, like: Camera) -> Draft:
    """The draft of a camera. Raises InputError for a file without noise or black level."""
    draft = Draft(file, like)
    parts = {
        name: x
        for one in draft.tables("algorithms", data["algorithms"])
        for name, x in one.items()
    }
    noise = draft.table("rpi.noise", parts.get("rpi.noise") or {})
    if "reference_slope" not in noise:
        raise InputError(
            f"{file}: rpi.noise has no reference_slope; its algorithms are {', '.join(parts)[:200]}. Take the tuning "
            "file of a calibrated sensor."
        )
    dn = 2.0 ** (draft.bits - SCALE_BITS)
    black_dn = (
        _black(draft.table("rpi.black_level", parts.get("rpi.black_level") or {}), draft) * dn
    )
    slope = draft.number("rpi.noise reference_slope", noise["reference_slope"], 0.0, 1e3)
    constant = draft.number(
        "rpi.noise reference_constant", noise.get("reference_constant", 0.0), -1e-9, 65535.0
    )
    dn_per_e = slope**2 * dn
    draft.assume(
        "adc.bits",
        draft.bits,
        f"as {like.name}; the file is in a scale of 16 bits (--set adc.bits=12)",
    )
    draft.set_gain(
        dn_per_e, f"rpi.noise reference_slope {slope:g} squared at {draft.bits} bits: K"
    )
    draft.says("adc.black_level_dn", black_dn, f"rpi.black_level at {draft.bits} bits")
    draft.set_clip(dn_per_e, black_dn)
    if constant > 0:
        how = f"rpi.noise reference_constant {constant:g} over reference_slope squared"
        draft.says("source_follower.read_noise_e", constant / slope**2, how)
    else:
        why = f"as {like.name}; reference_constant is 0, which says that the fit found no noise of darkness"
        draft.assume("source_follower.read_noise_e", like.source_follower.read_noise_e, why)
    shading = draft.table("rpi.alsc", parts.get("rpi.alsc") or {})
    _shading(shading.get("luminance_lut"), draft)
    draft.description = f"Sensor of the libcamera tuning file {file}, at analogue gain 1"
    return draft


def _black(part: dict[str, Any], draft: Draft) -> float:
    """The black level, or the mean of those of the colours [DN16]."""
    colours = [
        part[name]
        for name in ("black_level_r", "black_level_g", "black_level_b")
        if name in part
    ]
    values = colours or [part.get("black_level", 4096)]
    return float(np.mean([draft.number("rpi.black_level", x, -1e-9, 65534.0) for x in values]))


def _shading(table: object, draft: Draft) -> None:
    """The luminance table of rpi.alsc, a gain for every part of the picture, as fall-off of a lens by image height."""
    if table is None:
        return
    gains = draft.numbers("rpi.alsc luminance_lut", table, 1e-6, 1e6)
    if len(gains) not in GRIDS:
        raise InputError(
            f"{draft.file}: luminance_lut of rpi.alsc has {len(gains)} numbers; it must have 192 or 1024."
        )
    gain = np.array(gains).reshape(GRIDS[len(gains)])
    like = draft.like
    sides = (
        like.sensor.rows * like.pixel.pitch_y_um,
        like.sensor.columns * like.pixel.pitch_x_um,
    )
    y, x = (
        ((np.arange(n) + 0.5) / n - 0.5) * side * 1e-3
        for n, side in zip(gain.shape, sides, strict=True)
    )
    height, corner = np.hypot(y[:, None], x), 0.5e-3 * math.hypot(*sides)
    heights = np.linspace(0.0, corner, HEIGHTS)
    step, light = heights[1], 1 / gain
    near = np.maximum(1 - np.abs(height[..., None] - heights) / step, 0.0)
    weight = near.sum(axis=(0, 1))
    fall_off = (light[..., None] * near).sum(axis=(0, 1)) / np.maximum(weight, 1e-12)
    known = weight > 0.5
    fall_off = np.interp(heights, heights[known], fall_off[known])
    how = "rpi.alsc luminance_lut, its inverse averaged over circles; shading of the colours is left out"
    draft.says(
        "lens.relative_illumination",
        [float(v) for v in np.minimum(fall_off / fall_off[0], 1.0)],
        how,
    )
    draft.says(
        "lens.relative_illumination_heights_mm",
        [float(v) for v in heights],
        f"of {like.name}'s picture",
    )
