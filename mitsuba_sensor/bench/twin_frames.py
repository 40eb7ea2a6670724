"""Frames of a twin at the settings of real stacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

import mitsuba_sensor as ms

from ..core.types import Float64Array
from ..lab.frames.stack import Stack
from ..lab.twin import Twin

ASSUMED_K = 298.15
"""Temperature where frames do not say it, as of the camera file."""
SEED = 1288


@dataclass(frozen=True, eq=False)
class Simulated:
    """Takes frames of a twin.  camera : from its tables.  maps : measured ones."""

    twin: Twin
    camera: ms.Camera
    maps: Mapping[str, Float64Array]

    def like(self, real: Stack, number: int) -> Stack:
        """As many frames of the same light, exposure time and temperature.  number : of the stack; seeds its noise.

        The light is such that the mean of each filter is the real one.
        """
        wavelength_nm = self.twin.wavelength_nm or self.camera.quantum_efficiency.reference_nm
        wavelengths = [wavelength_nm or sum(self.camera.band_nm) / 2]
        exposure = ms.Exposure(real.exposure_s, real.temperature_k or ASSUMED_K)
        taken = ms.expose(
            self._photons(real, wavelengths)[..., None],
            self.camera,
            exposure,
            wavelengths_nm=wavelengths,
            maps=self.maps,
            frames=len(real),
            seed=SEED + number,
        )
        return replace(real, frames=taken.digital, source=f"twin of {real.source}")

    def _photons(self, real: Stack, wavelengths_nm: list[float]) -> Float64Array:
        """Mean photons per pixel, (H, W): the real signal of each filter in electrons over its quantum efficiency."""
        if real.dark:
            return np.zeros(real.shape)
        names, efficiency = self.camera.filter_names, self.camera.qe(wavelengths_nm)[:, 0]
        index = self.camera.filter_index(real.shape)
        signal = real.mean - self.twin.base.dark.expected_frame(real.exposure_s)
        found = np.zeros(real.shape)
        for number, name in enumerate(names):
            pixels = index == number
            response = self.twin.base.responses.get(name) or self.twin.base.brightest
            level = response.straight(np.array([max(float(signal[pixels].mean()), 0.0)]))[0]
            found[pixels] = (
                level
                / self.twin.base.gain.quantity.value
                / max(float(efficiency[number]), 1e-6)
            )
        return found
