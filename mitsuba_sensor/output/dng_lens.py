"""Lens corrections of a DNG: WarpRectilinear and FixVignetteRadial of the Digital Negative Specification 1.4, part 7.

A raw developer that knows them takes the distortion out of the picture and brightens its corners; the pixels of the
file are as the ADC delivers them. Numbers are big-endian, whatever the file is.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..camera.camera import Camera
from ..optics.calibration import Calibration, calibration_of

WARP_RECTILINEAR, FIX_VIGNETTE_RADIAL = 1, 3
VERSION = bytes((1, 3, 0, 0))  # of the specification that has both
OPTIONAL = 1  # a reader that does not know it may go on
POWERS = np.array([2, 4, 6, 8, 10])  # of the radius, in the gain of FixVignetteRadial
SQUARE = 1e-6  # pixels whose sides differ by no more


def lens_corrections(camera: Camera, intrinsics: Mapping[str, Any] | None) -> bytes:
    """OpcodeList3 of a picture with these intrinsics; nothing where there is nothing to correct, or it is not known.

    First the shading, where the light fell, then the distortion. Pixels that are not square have no WarpRectilinear.
    """
    if intrinsics is None or intrinsics["matrix"] is None:
        return b""
    calibration = calibration_of(intrinsics, camera.pixel.pitch_x_um)
    both = (_shading(calibration, intrinsics.get("shading")), _warp(calibration))
    opcodes = [opcode for opcode in both if opcode]
    if not opcodes:
        return b""
    return struct.pack(">I", len(opcodes)) + b"".join(opcodes)


def _warp(calibration: Calibration) -> bytes:
    """From the corrected picture to this one: Brown and Conrady's distortion, with radii over the farthest corner's."""
    (fx, fy), (k1, k2, p1, p2, k3) = calibration.focal, calibration.distortion
    if not any(calibration.distortion) or abs(fx / fy - 1) > SQUARE:
        return b""
    reach = _reach_px(calibration) / fx
    radial = 1.0, k1 * reach**2, k2 * reach**4, k3 * reach**6
    tangential = p1 * reach, p2 * reach
    parameters = struct.pack(">I8d", 1, *radial, *tangential, *_centre(calibration))
    return _opcode(WARP_RECTILINEAR, parameters)


def _shading(calibration: Calibration, shading: Mapping[str, list[float]] | None) -> bytes:
    """Gain 1 + k0·r² + … + k4·r¹⁰ over the radius, of least squares to the inverse of the relative illumination."""
    if shading is None:
        return b""
    radius = np.array(shading["radius_px"]) / _reach_px(calibration)
    gain = 1 / np.array(shading["relative_illumination"])
    if not np.isfinite(gain).all() or np.ptp(gain) == 0:
        return b""
    powers = radius[:, None] ** POWERS
    factors = np.linalg.lstsq(powers, gain - 1, rcond=None)[0]
    return _opcode(FIX_VIGNETTE_RADIAL, struct.pack(">7d", *factors, *_centre(calibration)))


def _opcode(number: int, parameters: bytes) -> bytes:
    return struct.pack(">I4sII", number, VERSION, OPTIONAL, len(parameters)) + parameters


def _centre(calibration: Calibration) -> tuple[float, float]:
    """Optical centre, 0 in the middle of the first pixel and 1 in that of the last one."""
    (cx, cy), columns, rows = calibration.principal, calibration.columns, calibration.rows
    return cx / max(columns - 1, 1), cy / max(rows - 1, 1)


def _reach_px(calibration: Calibration) -> float:
    """Distance of the middle of the farthest pixel from the optical centre."""
    (cx, cy), columns, rows = calibration.principal, calibration.columns, calibration.rows
    return math.hypot(max(abs(cx), abs(columns - 1 - cx)), max(abs(cy), abs(rows - 1 - cy)))
