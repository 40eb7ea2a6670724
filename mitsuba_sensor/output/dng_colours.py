"""Colour matrices of a DNG, from the quantum efficiencies of a camera, under CIE illuminants A and D65."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import Float64Array
from ..optics import spectra
from ..sensor.camera import Camera
from ..sensor.colour_matrix import colour_matrix, colour_order, standard_light

LIGHT_SOURCES = {"A": 17, "D65": 21}  # CIE illuminant → LightSource of Exif, in the order of the tags


class Calibration(NamedTuple):
    """What a DNG says of a camera under one illuminant; DNG 1.4, chapter 6.

    light_source : the illuminant, a LightSource of Exif.
    to_raw : (3, 3) ColorMatrix, from XYZ to raw red, green and blue; of white the largest is 1 where Y is 1.
    to_xyz : (3, 3) ForwardMatrix, from balanced red, green and blue to XYZ adapted to D50.
    """

    light_source: int
    to_raw: Float64Array
    to_xyz: Float64Array


def calibrations(camera: Camera) -> tuple[Calibration, ...]:
    """Of a camera with filters red, green and blue, under each illuminant that all of them detect; the others none."""
    return tuple(one for name in LIGHT_SOURCES if (one := _calibration(camera, name)) is not None)


def _calibration(camera: Camera, name: str) -> Calibration | None:
    """The matrix of the preview (see colour_matrix.py) under this illuminant, in the terms of DNG, whose readers adapt
    colours by the linear Bradford method."""
    light, order = standard_light(camera, name), colour_order(camera.filter_names)
    found = colour_matrix(camera, light)
    if found is None or order is None or found.illuminant != "scene":
        return None
    srgb_to_d50 = spectra.bradford(spectra.daylight_xyz(), spectra.d50_xyz()) @ np.linalg.inv(spectra.xyz_to_srgb())
    to_xyz = srgb_to_d50 @ found.to_srgb[:, order]
    white = spectra.observer(light.wavelengths_nm) @ light.power
    from_d50 = spectra.bradford(spectra.d50_xyz(), white / white[1])
    to_raw = np.linalg.inv(from_d50 @ to_xyz * found.white_balance[order])
    return Calibration(LIGHT_SOURCES[name], np.asarray(to_raw, np.float64), to_xyz)
