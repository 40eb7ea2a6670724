"""Temporal noise of a camera in electrons at its input, for comparison with render noise."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..camera.figures import saturation_e
from ..core import Electrons, Exposure, Frame, Photons, SensorWindow
from ..sensor.detection import Detected
from .clean import pixel_moments

LEVELS = 257
"""Exposure levels of the table, evenly spaced in ln(1 + μ): 6 % apart for a full well of 33 000 e-."""
WELLS_MAX = 4.0
"""End of the table [full wells], where pixels no longer respond to light."""
PIXELS = 9
"""Pixels of each level; the median of their variances ignores hot pixels."""
STEP_SIGMAS = 0.25
"""Difference of light for the slope [σ of its shot noise]."""
SLOPE_MIN = 1e-3
"""A smaller slope, over the largest one, is a saturated pixel."""
ROUNDING_DN2 = 1 / 12
"""Variance of rounding [DN²]: the least variance of a code, even if little noise shows it."""


@dataclass(frozen=True, eq=False)
class InputNoise:
    """Effect of an error of the mean photoelectrons on a frame.

    electrons_e : rising mean photoelectrons, shape (L,).
    weight_per_e2 : (dm/dμ)²/σ², shape (L,) [e-⁻²], with mean code m and temporal variance σ²; 0 for clipped pixels.
    """

    electrons_e: NDArray[np.float64]
    weight_per_e2: NDArray[np.float64]

    def ratio(self, mean_e: ArrayLike, variance_e2: ArrayLike) -> NDArray[np.float64]:
        """Return a variance of the mean photoelectrons over the camera's temporal variance, both at the input."""
        weight = np.interp(np.log1p(mean_e), np.log1p(self.electrons_e), self.weight_per_e2)
        return np.asarray(variance_e2, dtype=np.float64) * weight


def input_noise(camera: Camera, exposure: Exposure) -> InputNoise:
    """Compute the weights from clean pixels at many exposure levels; with shot noise only they are 1/μ (EMVA 1288 R4,
    eq. 11)."""
    try:
        return _input_noise(camera, exposure)
    except TypeError:  # a user's stage with arrays has no hash
        return _input_noise.__wrapped__(camera, exposure)


@lru_cache(maxsize=8)  # every part of a render needs the same camera
def _input_noise(camera: Camera, exposure: Exposure) -> InputNoise:
    levels = np.expm1(np.linspace(0.0, np.log1p(WELLS_MAX * saturation_e(camera)), LEVELS))
    code_e = 1 / camera.system_gain_dn_per_e  # a smaller step is invisible to a coarse ADC
    step = np.maximum(STEP_SIGMAS * np.sqrt(np.maximum(levels, 1.0)), 0.5 * code_e)
    frame = Frame(exposure, SensorWindow(0, (PIXELS, LEVELS), camera=camera.name))
    within_code_e = (
        code_e * (np.arange(PIXELS)[:, None] + 0.5) / PIXELS
    )  # averages the steps of the ADC

    def codes(light_e: NDArray[np.float64]) -> NDArray[np.float64]:
        light = light_e + within_code_e
        lit = Detected(Photons(light, detected=True), Electrons(light))
        mean, variance, _ = pixel_moments(camera.stages, lit, frame)
        floor_dn2 = np.maximum(variance, ROUNDING_DN2)
        return np.stack([mean.mean(axis=0), np.median(floor_dn2, axis=0)])

    low_e = np.maximum(levels - step, 0.0)
    (low, _), (high, _), (_, variance_dn2) = (codes(x) for x in (low_e, levels + step, levels))
    slope = (high - low) / (levels + step - low_e)
    slope[slope < SLOPE_MIN * slope.max()] = 0.0
    return InputNoise(levels, slope**2 / variance_dn2)
