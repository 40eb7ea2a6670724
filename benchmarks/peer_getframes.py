"""Simulate a camera with getframes: photon shot noise, dark current and its shot noise, full well, read noise, ADC.

Its dark current is given at a temperature; here it has that of our camera at the temperature of the exposure. What
getframes attaches to a frame without noise is left out, and its arrays are kept between the frames: its fastest way.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import Any

import getframes
import numpy as np
from cases import reference_qe
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.dark_current import dark_current_model
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise
from mitsuba_sensor.stages.gains import gain_dn_per_e, sense_gain_v_per_e

VERSION = getframes.__version__
ZERO_CELSIUS_K = 273.15


def frames(
    photons: NDArray[np.float64], camera: ms.Camera, exposure: ms.Exposure
) -> Iterator[NDArray[Any]]:
    """Endless frames (H, W) uint32, in float32 as ours, each with a seed of its own."""
    simulated = getframes.Camera(config_of(camera, photons.shape, exposure), precision="single")
    rate = (photons / exposure.time_s).astype(np.float32)
    kept = getframes.DetectorWorkspace()
    for seed in count(2):
        celsius = exposure.temperature_k - ZERO_CELSIUS_K
        yield simulated.expose(
            rate, exposure.time_s, celsius, seed=seed, include_truth=False, workspace=kept
        ).data


def config_of(
    camera: ms.Camera, shape: tuple[int, ...], exposure: ms.Exposure
) -> getframes.CameraConfig:
    """The parameters of getframes."""
    read_noise_v = SourceFollowerNoise.from_camera(camera).sigma_v
    return getframes.CameraConfig(
        name="the same camera",
        sensor_type="CMOS",
        resolution=(shape[0], shape[1]),
        pixel_size_um=5.0,  # for information only
        quantum_efficiency=reference_qe(camera),
        full_well_e=camera.pixel.full_well_e,
        bit_depth=camera.adc.bits,
        gain_e_per_adu=1 / gain_dn_per_e(camera),
        bias_offset_adu=camera.black_level_dn,
        read_noise_e=read_noise_v / sense_gain_v_per_e(camera),
        dark_current_e_per_s=dark_current_model(camera).rate_e_per_s(exposure.temperature_k),
        dark_current_ref_temp_c=exposure.temperature_k - ZERO_CELSIUS_K,
    )
