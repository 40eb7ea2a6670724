"""A camera's own temporal noise as electrons at its input, with which render noise is compared."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..camera.figures import saturation_e
from ..core import Electrons, Exposure, Frame, Photons, SensorWindow
from ..sensor.detection import Detected
from .clean import pixel_moments

LEVELS = 257  # light levels of the table, evenly spaced in ln(1 + μ): 6 % apart at a full well of 33 000 e-
BEYOND_WELL = 4.0  # the table ends at so many full wells; nothing is left of the light there
PIXELS = 9  # of each level: the median of their variances leaves out hot pixels
STEP = 0.25  # of the difference of light, in its shot noise
NO_SLOPE = 1e-3  # of the gain of small signals: full
ROUNDING_DN2 = (
    1 / 12
)  # variance of the rounding: the least that a code varies by, also where little noise shows it


@dataclass(frozen=True, eq=False)
class InputNoise:
    """How strongly an error of the mean photoelectrons shows in a frame.

    electrons_e : (L,) rising mean photoelectrons.  weight_per_e2 : (L,) (dm/dμ)²/σ² [e-⁻²], m the mean code and σ² its
        temporal variance; 0 where full well or converter clip.
    """

    electrons_e: NDArray[np.float64]
    weight_per_e2: NDArray[np.float64]

    def ratio(self, mean_e: ArrayLike, variance_e2: ArrayLike) -> NDArray[np.float64]:
        """Variance of the mean photoelectrons over the camera's own temporal variance, both at the input."""
        weight = np.interp(np.log1p(mean_e), np.log1p(self.electrons_e), self.weight_per_e2)
        return np.asarray(variance_e2, dtype=np.float64) * weight


def input_noise(camera: Camera, exposure: Exposure) -> InputNoise:
    """By clean pixels in light of many levels; far above the read noise the weight is 1/μ: shot noise (EMVA 1288 R4,
    eq. 11)."""
    try:
        return _input_noise(camera, exposure)
    except TypeError:  # a stage of the user's that holds arrays has no hash
        return _input_noise.__wrapped__(camera, exposure)


@lru_cache(maxsize=8)  # a camera is asked again for every part of a render
def _input_noise(camera: Camera, exposure: Exposure) -> InputNoise:
    levels = np.expm1(np.linspace(0.0, np.log1p(BEYOND_WELL * saturation_e(camera)), LEVELS))
    code_e = (
        1 / camera.system_gain_dn_per_e
    )  # so that a difference shows where the converter is coarse
    step = np.maximum(STEP * np.sqrt(np.maximum(levels, 1.0)), 0.5 * code_e)
    frame = Frame(exposure, SensorWindow(0, (PIXELS, LEVELS), camera=camera.name))
    within_code_e = code_e * (np.arange(PIXELS)[:, None] + 0.5) / PIXELS  # evens out the steps

    def codes(light_e: NDArray[np.float64]) -> NDArray[np.float64]:
        light = light_e + within_code_e
        lit = Detected(Photons(light, detected=True), Electrons(light))
        mean, variance, _ = pixel_moments(camera.stages, lit, frame)
        floor_dn2 = np.maximum(variance, ROUNDING_DN2)
        return np.stack([mean.mean(axis=0), np.median(floor_dn2, axis=0)])

    low_e = np.maximum(levels - step, 0.0)
    (low, _), (high, _), (_, variance_dn2) = (codes(x) for x in (low_e, levels + step, levels))
    slope = (high - low) / (levels + step - low_e)
    slope[slope < NO_SLOPE * slope.max()] = 0.0
    return InputNoise(levels, slope**2 / variance_dn2)
