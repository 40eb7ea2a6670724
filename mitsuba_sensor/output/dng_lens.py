"""Lens corrections of a DNG: WarpRectilinear and FixVignetteRadial of the Digital Negative Specification 1.4, part 7.

Raw converters that support them remove the distortion and brighten the corners; the pixels of the file are uncorrected.
Numbers are big-endian in every file.
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
VERSION = bytes((1, 3, 0, 0))  # first specification with both
OPTIONAL = 1  # readers may ignore the correction
POWERS = np.array([2, 4, 6, 8, 10])  # powers of the radius in the gain of FixVignetteRadial
SQUARE_TOLERANCE = 1e-6  # relative difference of the sides of a square pixel


def lens_corrections(camera: Camera, intrinsics: Mapping[str, Any] | None) -> bytes:
    """Return OpcodeList3 for these intrinsics; b"" without known corrections.

    Shading is corrected before distortion. Pixels that are not square get no WarpRectilinear.
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
    """Return Brown and Conrady's distortion of the corrected picture, with radii relative to the farthest corner."""
    (fx, fy), (k1, k2, p1, p2, k3) = calibration.focal, calibration.distortion
    if not any(calibration.distortion) or abs(fx / fy - 1) > SQUARE_TOLERANCE:
        return b""
    corner = _corner_px(calibration) / fx
    radial = 1.0, k1 * corner**2, k2 * corner**4, k3 * corner**6
    tangential = p1 * corner, p2 * corner
    parameters = struct.pack(">I8d", 1, *radial, *tangential, *_centre(calibration))
    return _opcode(WARP_RECTILINEAR, parameters)


def _shading(calibration: Calibration, shading: Mapping[str, list[float]] | None) -> bytes:
    """Return the gain 1 + k0·r² + … + k4·r¹⁰, fitted by least squares to the inverse relative illumination."""
    if shading is None:
        return b""
    radius = np.array(shading["radius_px"]) / _corner_px(calibration)
    gain = 1 / np.array(shading["relative_illumination"])
    if not np.isfinite(gain).all() or np.ptp(gain) == 0:
        return b""
    powers = radius[:, None] ** POWERS
    factors = np.linalg.lstsq(powers, gain - 1, rcond=None)[0]
    return _opcode(FIX_VIGNETTE_RADIAL, struct.pack(">7d", *factors, *_centre(calibration)))


def _opcode(number: int, parameters: bytes) -> bytes:
    return struct.pack(">I4sII", number, VERSION, OPTIONAL, len(parameters)) + parameters


def _centre(calibration: Calibration) -> tuple[float, float]:
    """Return the optical centre, 0 at the centre of the first pixel and 1 at the centre of the last pixel."""
    (cx, cy), columns, rows = calibration.principal, calibration.columns, calibration.rows
    return cx / max(columns - 1, 1), cy / max(rows - 1, 1)


def _corner_px(calibration: Calibration) -> float:
    """Return the distance of the centre of the farthest pixel from the optical centre [pixel]."""
    (cx, cy), columns, rows = calibration.principal, calibration.columns, calibration.rows
    return math.hypot(max(abs(cx), abs(columns - 1 - cx)), max(abs(cy), abs(rows - 1 - cy)))
