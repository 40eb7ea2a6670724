"""Reads tuning files of libcamera for the Raspberry Pi (version 2): noise, black level, shading, companding.

The files are JSON or, with commas before closing brackets, YAML, as in libcamera's parser. All values have a scale of
16 bits (Raspberry Pi Camera Algorithm and Tuning Guide; utils/raspberrypi/ctt/ctt_noise): the standard deviation of a
pixel at gain 1 is reference_constant + reference_slope·√(value above black). Shot noise has σ² = K·value, so
K = reference_slope² [DN16/e-]; the constant is the dark noise.
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
COMPANDED_BITS = 12
"""Bits of a companded code without bitdepth."""
COLOUR_ALGORITHMS = ("rpi.awb", "rpi.nn.awb", "rpi.ccm")
"""A file of a monochrome sensor has none of these."""
MONOCHROME = "sony_imx174"
TARGETS = {"bcm2835": "bcm2835 (vc4, Raspberry Pi 0 to 4)", "pisp": "pisp (Raspberry Pi 5)"}
"""Value of target → full name. For the same sensor, K is twice as large in the file for pisp (imx477: slopes 3.9 and
2.767; photon transfer agrees with 2.767)."""
IMAGE_HEIGHTS = 9
"""From the axis to the corner."""


def is_tuning(data: object) -> bool:
    """Return True if a JSON file is a tuning file."""
    return isinstance(data, dict) and isinstance(data.get("algorithms"), list)


def read_tuning(data: dict[str, Any], file: str, like: Camera) -> Draft:
    """Return the draft of a camera. Raises InputError for a file without rpi.noise, and for values out of range."""
    draft = Draft(file, like)
    algorithms: dict[str, object] = {}
    for table in draft.tables("algorithms", data["algorithms"]):
        algorithms |= table

    def settings(name: str) -> dict[str, Any]:
        return draft.table(name, algorithms.get(name) or {})

    noise, decompand, shading = map(settings, ("rpi.noise", "rpi.decompand", "rpi.alsc"))
    draft.refuse_misspelled(noise, ("reference_slope", "reference_constant"))
    if "reference_slope" not in noise:
        raise InputError(
            f"{file} has no reference_slope in rpi.noise, only {', '.join(algorithms)[:200]}; give the tuning file of "
            "a calibrated sensor."
        )
    if decompand.get("decompand_curve") is not None:
        _set_companding(draft, decompand)
    else:
        why = f"as {like.name}, because the file has a scale of 16 bits (set adc.bits)"
        draft.assume("adc.bits", draft.bits, why)
    dn_per_dn16 = 2.0 ** (draft.bits - SCALE_BITS)
    black_dn = _black_dn16(settings("rpi.black_level"), draft) * dn_per_dn16
    slope = draft.number("rpi.noise reference_slope", noise["reference_slope"], 0.0, 1e3)
    constant = draft.number(
        "rpi.noise reference_constant", noise.get("reference_constant", 0.0), -1e-9, 65535.0
    )
    dn_per_e = slope**2 * dn_per_dn16
    target = TARGETS.get(str(data.get("target")), "an unknown target")
    how = f"rpi.noise reference_slope {slope:g} squared at {draft.bits} bits, for {target}: K"
    draft.set_gain(dn_per_e, how)
    if not any(name in algorithms for name in COLOUR_ALGORITHMS):
        _set_monochrome(draft)
    draft.says("adc.black_level_dn", black_dn, f"rpi.black_level at {draft.bits} bits")
    draft.set_clip(dn_per_e, black_dn)
    if constant > 0:
        how = f"rpi.noise reference_constant {constant:g} over reference_slope squared"
        draft.says("source_follower.read_noise_e", constant / slope**2, how)
    else:
        why = f"as {like.name}, because reference_constant is 0: the fit found no dark noise"
        draft.assume("source_follower.read_noise_e", like.source_follower.read_noise_e, why)
    if shading.get("luminance_lut") is not None:
        _set_shading(draft, shading["luminance_lut"])
    draft.description = (
        f"Sensor of the libcamera tuning file {file}, at analogue gain 1; the file is for {target}, and K of one "
        "sensor differs by a factor of two between files for bcm2835 and pisp"
    )
    return draft


def _set_monochrome(draft: Draft) -> None:
    """Replace colour filters of the similar camera by a monochrome quantum efficiency."""
    if len(draft.like.quantum_efficiency.curves) > 1:
        why = f"as {MONOCHROME}; without {', '.join(COLOUR_ALGORITHMS)} this is a monochrome sensor"
        section = load_camera(MONOCHROME).quantum_efficiency
        for name in ("wavelengths_nm", "curves", "tile", "reference_nm"):
            draft.assume(f"quantum_efficiency.{name}", getattr(section, name), why)


def _black_dn16(table: dict[str, Any], draft: Draft) -> float:
    """Return the black level, or its mean over the colours [DN16]."""
    names = ("black_level_r", "black_level_g", "black_level_b")
    levels = [table[name] for name in names if name in table] or [
        table.get("black_level", 4096)
    ]
    numbers = [draft.number("rpi.black_level", level, -1e-9, 65534.0) for level in levels]
    return float(np.mean(numbers))


def _set_companding(draft: Draft, table: Mapping[str, object]) -> None:
    """Set the knees from the curve of rpi.decompand: pairs of companded and linear code with a scale of 16 bits."""
    numbers = draft.numbers(
        "rpi.decompand decompand_curve", table["decompand_curve"], -1e-9, 65536.0
    )
    if len(numbers) < 4 or len(numbers) % 2:
        raise InputError(
            f"{draft.file}: decompand_curve of rpi.decompand has {len(numbers)} numbers; it must have pairs of "
            "companded and linear code."
        )
    bitdepth = draft.number("rpi.decompand bitdepth", table.get("bitdepth", 0), -1e-9, 16.0)
    bits, highest = int(bitdepth) or COMPANDED_BITS, 2**SCALE_BITS - 1
    knees = {0: 0}
    for companded, linear in zip(numbers[::2], numbers[1::2], strict=True):
        code = round(companded * 2.0 ** (bits - SCALE_BITS))
        knees[min(round(linear), highest)] = min(code, 2**bits - 1)
    draft.says("adc.bits", SCALE_BITS, "the linear code of rpi.decompand has 16 bits")
    how = "rpi.decompand decompand_curve, with a scale of 16 bits"
    draft.says("companding.bits", bits, "rpi.decompand bitdepth, or 12")
    draft.says("companding.knees", [list(pair) for pair in knees.items()], how)


def _set_shading(draft: Draft, table: object) -> None:
    """Set the relative illumination by image height from rpi.alsc, a table of gains over the picture."""
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
    heights = np.linspace(0.0, corner, IMAGE_HEIGHTS)
    step, light = heights[1], 1 / gain
    near = np.maximum(1 - np.abs(height[..., None] - heights) / step, 0.0)
    weight = near.sum(axis=(0, 1))
    fall_off = (light[..., None] * near).sum(axis=(0, 1)) / np.maximum(weight, 1e-12)
    covered = weight > 0.5
    fall_off = np.interp(heights, heights[covered], fall_off[covered])
    illumination = np.minimum(fall_off / fall_off[0], 1.0)
    how = "rpi.alsc luminance_lut, its inverse averaged over circles; colour shading is ignored"
    draft.says("lens.relative_illumination", illumination.tolist(), how)
    draft.says(
        "lens.relative_illumination_heights_mm", heights.tolist(), f"of {like.name}'s picture"
    )


def _middles_mm(count: int, side_um: float) -> Float64Array:
    """Return the centres of ``count`` equal parts of a side, from its centre [mm]."""
    return ((np.arange(count) + 0.5) / count - 0.5) * side_um * 1e-3
