"""ISO speed of a camera in daylight, by the light that saturates it (ISO 12232)."""

from __future__ import annotations

import numpy as np

from ..core import Exposure
from ..optics import spectra
from ..render.light.photons import photons_per_irradiance
from ..sensor.camera import Camera
from ..sensor.colour_matrix import STEP_NM, standard_light
from ..sensor.metering import saturation_e

SATURATION_LX_S = 78.0
"""ISO 12232: a speed by saturation is this over the exposure at the focal plane that saturates."""


def iso_speed(camera: Camera) -> float | None:
    """S_sat = 78 lx·s/H_sat: H_sat of CIE D65 makes the most sensitive of the camera's pixels saturate.

    The number of the camera's gain setting where that is an ISO number. Raises InputError where darkness is at the
    highest code.
    """
    number = next((one.iso for one in camera.gains if one.label == camera.gain), None)
    if number is not None:
        return float(number)
    middles, power = standard_light(camera, spectra.DAYLIGHT)
    bands = photons_per_irradiance(camera, Exposure(1.0), middles, np.full(middles.size, STEP_NM))
    electrons_per_lx_s = camera.qe(middles) @ (bands * power) / spectra.luminous(middles, power)
    return float(SATURATION_LX_S * electrons_per_lx_s.max() / saturation_e(camera)) or None
