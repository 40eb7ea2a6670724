"""Simulate a camera with GalSim: CCDNoise (shot noise and read noise), black level, quantisation, uint16."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import galsim
import numpy as np
from cases import reference_qe
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise
from mitsuba_sensor.stages.gains import gain_dn_per_e, sense_gain_v_per_e

VERSION = galsim.__version__


def frames(
    photons: NDArray[np.float64], camera: ms.Camera, exposure: ms.Exposure
) -> Iterator[NDArray[Any]]:
    """Endless frames (H, W) uint16. GalSim does not clip at the ends of the ADC range, so NumPy does."""
    qe = reference_qe(camera)
    dn_per_e, dark_dn = gain_dn_per_e(camera), camera.black_level_dn
    read_noise_e = SourceFollowerNoise.from_camera(camera).sigma_v / sense_gain_v_per_e(camera)
    noise = galsim.CCDNoise(galsim.BaseDeviate(2), gain=1 / dn_per_e, read_noise=read_noise_e)
    while True:
        image = galsim.ImageF((photons * (qe * dn_per_e)).astype(np.float32))
        image.addNoise(noise)
        image += dark_dn
        image.quantize()
        yield np.clip(image.array, 0, 2**camera.adc.bits - 1).astype(np.uint16)
