"""Reads tuning files of libcamera for the Raspberry Pi (version 2): noise, black level, shading, companding.

They are JSON or, with commas before closing brackets, YAML, as libcamera's own parser reads them.

All in a scale of 16 bits (Raspberry Pi Camera Algorithm and Tuning Guide; utils/raspberrypi/ctt/ctt_noise): the
standard deviation of a pixel at gain 1 is reference_constant + reference_slope·√(value above black). Shot noise has
σ² = K·value, so K = reference_slope² [DN16/e-]; the constant is the noise of darkness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...camera.camera import Camera
from ...camera.camera_file import load_camera
from ...core import Float64Array, InputError
from .draft import Draft

SCALE_BITS = 16
GRIDS = {192: (12, 16), 1024: (32, 32)}
"""Length of a table of rpi.alsc → its rows and columns."""
USUAL_BITS = 12
"""Of a companded code whose file does not say them."""
COLOUR = ("rpi.awb", "rpi.nn.awb", "rpi.ccm")
"""Algorithms for colours, of which a file of a monochrome sensor has none."""
MONOCHROME = "sony_imx174"
TARGETS = {"bcm2835": "bcm2835 (vc4, Raspberry Pi 0 to 4)", "pisp": "pisp (Raspberry Pi 5)"}
"""Value of target → its name in full. For the same sensor, K is twice as large in the file for pisp (imx477: slopes 3.9
and 2.767, where photon transfer agrees with the second)."""
HEIGHTS = 9
"""Image heights of the fall-off, from the axis to the corner."""


def is_tuning(data: object) -> bool:
    """Whether a JSON file is a tuning file."""
    return isinstance(data, dict) and isinstance(data.get("algorithms"), list)


def read_tuning(data: dict[str, Any], file: str, like: Camera) -> Draft:
    """The draft of a camera. Raises InputError for a file without noise or black level."""
    draft = Draft(file, like)
    algorithms: dict[str, object] = {}
    for table in draft.tables("algorithms", data["algorithms"]):
        algorithms |= table
    noise = draft.table("rpi.noise", algorithms.get("rpi.noise") or {})
    if "reference_slope" not in noise:
        raise InputError(
            f"{file}: rpi.noise has no reference_slope; its algorithms are {', '.join(algorithms)[:200]}. Take the "
            "tuning file of a calibrated sensor."
        )
    decompand = draft.table("rpi.decompand", algorithms.get("rpi.decompand") or {})
    if decompand.get("decompand_curve") is not None:
        _set_companding(draft, decompand)
    else:
        why = f"as {like.name}; the file is in a scale of 16 bits (--set adc.bits=12)"
        draft.assume("adc.bits", draft.bits, why)
    dn_per_dn16 = 2.0 ** (draft.bits - SCALE_BITS)
    black_level = draft.table("rpi.black_level", algorithms.get("rpi.black_level") or {})
    black_dn = _black_dn16(black_level, draft) * dn_per_dn16
    slope = draft.number("rpi.noise reference_slope", noise["reference_slope"], 0.0, 1e3)
    constant = draft.number(
        "rpi.noise reference_constant", noise.get("reference_constant", 0.0), -1e-9, 65535.0
    )
    dn_per_e = slope**2 * dn_per_dn16
    target = TARGETS.get(str(data.get("target")), "a target that it does not say")
    how = f"rpi.noise reference_slope {slope:g} squared at {draft.bits} bits, for {target}: K"
    draft.set_gain(dn_per_e, how)
    if not any(name in algorithms for name in COLOUR):
        _set_monochrome(draft)
    draft.says("adc.black_level_dn", black_dn, f"rpi.black_level at {draft.bits} bits")
    draft.set_clip(dn_per_e, black_dn)
    if constant > 0:
        how = f"rpi.noise reference_constant {constant:g} over reference_slope squared"
        draft.says("source_follower.read_noise_e", constant / slope**2, how)
    else:
        why = f"as {like.name}; reference_constant is 0, which says that the fit found no noise of darkness"
        draft.assume("source_follower.read_noise_e", like.source_follower.read_noise_e, why)
    shading = draft.table("rpi.alsc", algorithms.get("rpi.alsc") or {})
    if shading.get("luminance_lut") is not None:
        _set_shading(draft, shading["luminance_lut"])
    draft.description = (
        f"Sensor of the libcamera tuning file {file}, at analogue gain 1; the file is for {target}, and files of one "
        "sensor for bcm2835 and pisp differ by a factor of two in K"
    )
    return draft


def _set_monochrome(draft: Draft) -> None:
    """A sensor without colour filters, where the other numbers are those of a camera with some."""
    if len(draft.like.quantum_efficiency.curves) > 1:
        why = f"as {MONOCHROME}; the file has none of {', '.join(COLOUR)}: a monochrome sensor"
        section = load_camera(MONOCHROME).quantum_efficiency
        for name in ("wavelengths_nm", "curves", "tile", "reference_nm"):
            draft.assume(f"quantum_efficiency.{name}", getattr(section, name), why)


def _black_dn16(table: dict[str, Any], draft: Draft) -> float:
    """The black level, or the mean of those of the colours [DN16]."""
    names = ("black_level_r", "black_level_g", "black_level_b")
    levels = [table[name] for name in names if name in table]
    if not levels:
        levels = [table.get("black_level", 4096)]
    numbers = [draft.number("rpi.black_level", level, -1e-9, 65534.0) for level in levels]
    return float(np.mean(numbers))


def _set_companding(draft: Draft, table: Mapping[str, object]) -> None:
    """The curve of rpi.decompand, pairs of companded and linear code in a scale of 16 bits, as knees."""
    numbers = draft.numbers(
        "rpi.decompand decompand_curve", table["decompand_curve"], -1e-9, 65536.0
    )
    if len(numbers) < 4 or len(numbers) % 2:
        raise InputError(
            f"{draft.file}: decompand_curve of rpi.decompand has {len(numbers)} numbers; it must have pairs of them, "
            "companded and linear code."
        )
    said_bits = draft.number("rpi.decompand bitdepth", table.get("bitdepth", 0), -1e-9, 16.0)
    bits, highest = int(said_bits) or USUAL_BITS, 2**SCALE_BITS - 1
    knees = {0: 0}
    for companded, linear in zip(numbers[::2], numbers[1::2], strict=True):
        code = round(companded * 2.0 ** (bits - SCALE_BITS))
        knees[min(round(linear), highest)] = min(code, 2**bits - 1)
    draft.says("adc.bits", SCALE_BITS, "the linear code of rpi.decompand has 16 bits")
    how = "rpi.decompand decompand_curve, pairs in a scale of 16 bits"
    draft.says("companding.bits", bits, "rpi.decompand bitdepth, or 12")
    draft.says("companding.knees", [list(pair) for pair in knees.items()], how)


def _set_shading(draft: Draft, table: object) -> None:
    """The luminance table of rpi.alsc, a gain for every part of the picture, as fall-off of a lens by image height."""
    gains = draft.numbers("rpi.alsc luminance_lut", table, 1e-6, 1e6)
    if len(gains) not in GRIDS:
        raise InputError(
            f"{draft.file}: luminance_lut of rpi.alsc has {len(gains)} numbers; it must have 192 or 1024."
        )
    gain = np.array(gains).reshape(GRIDS[len(gains)])
    like = draft.like
    height_um = like.sensor.rows * like.pixel.pitch_y_um
    width_um = like.sensor.columns * like.pixel.pitch_x_um
    y = _middles_mm(gain.shape[0], height_um)
    x = _middles_mm(gain.shape[1], width_um)
    height, corner = np.hypot(y[:, None], x), 0.5e-3 * math.hypot(height_um, width_um)
    heights = np.linspace(0.0, corner, HEIGHTS)
    step, light = heights[1], 1 / gain
    near = np.maximum(1 - np.abs(height[..., None] - heights) / step, 0.0)
    weight = near.sum(axis=(0, 1))
    fall_off = (light[..., None] * near).sum(axis=(0, 1)) / np.maximum(weight, 1e-12)
    known = weight > 0.5
    fall_off = np.interp(heights, heights[known], fall_off[known])
    illumination = np.minimum(fall_off / fall_off[0], 1.0)
    how = "rpi.alsc luminance_lut, its inverse averaged over circles; shading of the colours is left out"
    draft.says("lens.relative_illumination", illumination.tolist(), how)
    draft.says(
        "lens.relative_illumination_heights_mm", heights.tolist(), f"of {like.name}'s picture"
    )


def _middles_mm(count: int, side_um: float) -> Float64Array:
    """Middles of so many parts of a side, 0 in the middle of the side [mm]."""
    return ((np.arange(count) + 0.5) / count - 0.5) * side_um * 1e-3
