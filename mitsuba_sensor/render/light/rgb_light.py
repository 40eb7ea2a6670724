"""Light from pictures: red, green and blue as radiance in front of a camera's lens."""

from __future__ import annotations

import hashlib
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...camera.camera_file import AnyCamera, camera_of
from ...core import (
    Exposure,
    Float32Array,
    InputError,
    NumpyArray,
    check_types,
    nearest,
    require,
)
from ...core.checks import PICTURE_FILE, refuse_masked, refuse_path
from ...optics import spectra
from .foreign_light import (
    D65_OF_WHITE,
    behind_glare,
    behind_lens,
    irradiance_of,
    upsampled,
)
from .irradiance import Irradiance

RgbUnit = Literal["radiance_rgb", "cd_per_m2", "srgb"]
RGB_UNITS = {
    "radiance_rgb": "linear sRGB as Mitsuba has it: 1, 1, 1 is D65 of 73 000 cd/m²",
    "cd_per_m2": "linear sRGB: 1, 1, 1 is D65 of 1 cd/m²",
    "srgb": "a picture behind the sRGB curve",
}
NO_UNIT = (
    'unit is not given, and an array does not say how bright its values are; for a picture pass unit="srgb" and '
    'the luminance of its white, e.g. white_cd_per_m2=200; for linear sRGB pass unit="cd_per_m2", where 1, 1, 1 is '
    'D65 of 1 cd/m², or unit="radiance_rgb", as Mitsuba has it, where it is D65 of 73 000 cd/m².'
)
MOST_SRGB = 1.001
EIGHT_BITS = 255
SURE = "give it planes last: np.moveaxis(rgb, 0, -1)"


def light_from_rgb(
    rgb: ArrayLike,
    camera: AnyCamera,
    *,
    unit: RgbUnit | None = None,
    white_cd_per_m2: float | None = None,
    fov_deg: float | None = None,
) -> Irradiance:
    """Irradiance on the sensor of a camera that looks at a picture.

    ::

        light = ms.light_from_rgb(picture, "bayer_2mp", unit="srgb", white_cd_per_m2=200)
        ms.capture(light, "bayer_2mp", ms.Exposure(0.01)).save("out/")

    rgb : (H, W, 3); a pixel of it is a pixel of the sensor.
    camera : whose lens the light passes.
    unit : what the values are, which no array says by itself. "radiance_rgb": linear sRGB as Mitsuba renders it, where
        (1, 1, 1) is D65 of 73 000 cd/m². "cd_per_m2": linear sRGB, where (1, 1, 1) is D65 of 1 cd/m². "srgb": a
        picture behind the sRGB curve, uint8 or 0 to 1, whose white has ``white_cd_per_m2``.
    white_cd_per_m2 : luminance of white in a picture [cd/m²]: a screen 200, a cloudy day 5000.
    fov_deg : horizontal field of view [°], for the cos⁴ of the lens; without it there is none.

    Each colour becomes the smooth spectrum that Mitsuba gives it (Jakob & Hanika 2019), times D65: light beyond the
    visible is a guess. Raises InputError.
    """
    camera = camera_of(camera)
    check_types(camera, Exposure(0.0))
    refuse_masked("rgb", rgb)
    refuse_path("rgb", rgb, PICTURE_FILE)
    values = np.asarray(rgb)
    _check_shape(values)
    linear = _linear(values, unit, white_cd_per_m2)
    bad = ~np.isfinite(linear) | (linear < 0)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"rgb is negative or not finite in {int(bad.sum())} value(s), first at {first}; clamp or correct them."
        )
    bands, lens = behind_lens(upsampled(linear, camera), camera, fov_deg)
    notes = (
        f"read as {RGB_UNITS[str(unit)]}",
        "RGB up-sampled by Jakob & Hanika 2019 as in Mitsuba, times D65",
        lens,
    )
    light = irradiance_of(bands, notes, hashlib.sha256(linear.tobytes()).hexdigest())
    return behind_glare(light, camera)


def luminance_of_white() -> float:
    """Luminance of Mitsuba's RGB (1, 1, 1) [cd/m²]."""
    low_nm, high_nm = spectra.VISIBLE_NM
    fine_nm = np.arange(low_nm, high_nm + 1)
    return spectra.luminous(fine_nm, spectra.d65(fine_nm) / D65_OF_WHITE)


def _check_shape(values: NumpyArray) -> None:
    """Raise InputError unless it is (H, W, 3)."""
    shape = values.shape
    if len(shape) == 3 and shape[0] == 3 and shape[2] != 3:
        raise InputError(f"rgb has shape {shape}, colour planes first; {SURE}.")
    if len(shape) == 3 and shape[2] == 4:
        raise InputError(f"rgb has shape {shape}, with transparency; pass rgb[..., :3].")
    if len(shape) != 3 or shape[2] != 3 or 0 in shape:
        raise InputError(f"rgb has shape {shape}; pass (H, W, 3): red, green and blue.")
    if values.dtype.kind not in "iuf":
        raise InputError(f"rgb is of {values.dtype}; pass integers or floats.")


def _linear(
    values: NumpyArray, unit: str | None, white_cd_per_m2: float | None
) -> Float32Array:
    """Values in the unit of Mitsuba's RGB."""
    if unit is None:
        raise InputError(NO_UNIT)
    if not isinstance(unit, str) or unit not in get_args(RgbUnit):
        known = get_args(RgbUnit)
        raise InputError(
            f"unit is {unit!r}; it must be one of {', '.join(known)}.{nearest(str(unit), known)}"
        )
    if (white_cd_per_m2 is not None) != (unit == "srgb"):
        needs = (
            "say how bright its white is, e.g. white_cd_per_m2=200"
            if unit == "srgb"
            else 'white_cd_per_m2 is for unit "srgb"; leave it out'
        )
        raise InputError(f"unit is {unit!r}; {needs}.")
    if values.dtype.kind in "iu" and unit != "srgb":
        raise InputError(
            f"rgb is of {values.dtype}, as a picture has it, and unit is {unit!r}; "
            'pass unit="srgb" and white_cd_per_m2, or floats.'
        )
    if white_cd_per_m2 is None:
        factor = 1.0 if unit == "radiance_rgb" else 1 / luminance_of_white()
        return np.asarray(values.astype(np.float32) * np.float32(factor), np.float32)
    white = require("white_cd_per_m2", white_cd_per_m2, 0.0, 1e10, "cd/m², e.g. 200")
    encoded = np.asarray(values, np.float32)
    if values.dtype == np.uint8:
        encoded = encoded / np.float32(EIGHT_BITS)
    if (values.dtype.kind in "iu" and values.dtype != np.uint8) or encoded.max() > MOST_SRGB:
        raise InputError(
            f'rgb is of {values.dtype} up to {values.max()} and unit "srgb"; pass uint8, or floats from 0 to 1.'
        )
    factor = white / luminance_of_white()
    return np.asarray(spectra.inverse_srgb_curve(encoded) * np.float32(factor), np.float32)
