"""A camera's own temporal noise as electrons at its input, with which render noise is compared."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Exposure, Frame, Moments, SensorWindow
from .camera import Camera
from .stage import converter_of, propagate

LEVELS = 513  # light levels of the table, evenly spaced in ln(1 + μ): 3 % apart at a full well of 33 000 e-
BEYOND_WELL = 4.0  # the table ends at so many full wells; nothing is left of the light there


@dataclass(frozen=True, eq=False)
class InputNoise:
    """How strongly an error of the mean photoelectrons shows in a frame.

    electrons_e : (L,) rising mean photoelectrons.  weight_per_e2 : (L,) (dS/dμ)²/σ_S² [e-⁻²], S the signal at the
        converter with all temporal noise and the converter's 1/12 LSB²; 0 where full well or converter clip.
    """

    electrons_e: NDArray[np.float64]
    weight_per_e2: NDArray[np.float64]

    def ratio(self, mean_e: ArrayLike, variance_e2: ArrayLike) -> NDArray[np.float64]:
        """Variance of the mean photoelectrons over the camera's own temporal variance, both at the input."""
        weight = np.interp(np.log1p(mean_e), np.log1p(self.electrons_e), self.weight_per_e2)
        return np.asarray(variance_e2, dtype=np.float64) * weight


def input_noise(camera: Camera, exposure: Exposure) -> InputNoise:
    """From the moments of the chain; far above the read noise the weight is 1/μ: shot noise (EMVA 1288 R4, eq. 11)."""
    most = BEYOND_WELL * camera.pixel.full_well_e
    levels = np.expm1(np.linspace(0.0, np.log1p(most), LEVELS))
    dark = Moments(levels[None, :], 0.0, 0.0, Frame(exposure, SensorWindow(0, (1, LEVELS))))
    m, converter = propagate(camera.stages[1:-1], dark), converter_of(camera.stages)
    gain = converter.gain_dn_per_v
    signal, variance = np.ravel(m.mean) * gain, np.ravel(np.broadcast_to(m.temporal, (1, LEVELS))) * gain**2 + 1 / 12
    slope = np.gradient(signal, levels)
    slope[signal + converter.black_level_dn >= converter.highest] = 0.0
    return InputNoise(levels, slope**2 / variance)
