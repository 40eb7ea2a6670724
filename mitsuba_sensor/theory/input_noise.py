"""A camera's own temporal noise as electrons at its input, with which render noise is compared."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..camera.figures import saturation_e
from ..core import Exposure, Frame, SensorWindow
from ..stages.stage import Chain, converter_of, without, without_law
from .combined_theory import codes_by_light
from .pixel_codes import SHARP_DN
from .response import behind_stages_at

LEVELS = 513  # light levels of the table, evenly spaced in ln(1 + μ): 3 % apart at a full well of 33 000 e-
BEYOND_WELL = 4.0  # the table ends at so many full wells; nothing is left of the light there
NO_SLOPE = 1e-9  # of the largest: full, up to the last digits of the theory
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
    """From the theory of the codes; far above the read noise the weight is 1/μ: shot noise (EMVA 1288 R4, eq. 11).

    Stages whose law nobody has written are left out of it.
    """
    if camera.readouts:
        return _of_combined(camera, exposure)
    stages = without(camera.stages, without_law(camera.stages))
    try:
        return _of_chain(stages, camera.pixel.full_well_e, exposure)
    except TypeError:  # a stage of the user's that holds arrays has no hash
        return _of_chain.__wrapped__(stages, camera.pixel.full_well_e, exposure)


def _of_combined(camera: Camera, exposure: Exposure) -> InputNoise:
    """Of the linear code of several read-outs."""
    levels = np.expm1(np.linspace(0.0, np.log1p(BEYOND_WELL * saturation_e(camera)), LEVELS))
    frame = Frame(exposure, SensorWindow(0, (1, 1)))
    mean_dn, variance_dn2 = codes_by_light(camera.combined_readouts, frame, levels)
    return _of_codes(levels, mean_dn, variance_dn2)


def _of_codes(
    levels: NDArray[np.float64],
    mean_dn: NDArray[np.float64],
    variance_dn2: NDArray[np.float64],
) -> InputNoise:
    """From mean and temporal variance of the code at these levels of light [e-]."""
    slope = np.gradient(mean_dn, levels)
    slope[slope < NO_SLOPE * slope.max()] = 0.0
    return InputNoise(levels, slope**2 / np.maximum(variance_dn2, ROUNDING_DN2))


@lru_cache(maxsize=8)  # it takes as long as a short render
def _of_chain(stages: Chain, full_well_e: float, exposure: Exposure) -> InputNoise:
    levels = np.expm1(np.linspace(0.0, np.log1p(BEYOND_WELL * full_well_e), LEVELS))
    last, converter = len(stages) - 1, converter_of(stages)
    behind = behind_stages_at(
        stages, Frame(exposure, SensorWindow(0, (1, 1))), levels, [last - 1, last]
    )
    (swing_v, swing_v2), (mean_dn, variance_dn2) = behind[last - 1], behind[last]
    if (
        converter.gain_dn_per_v * np.sqrt(swing_v2.min()) < SHARP_DN
    ):  # the codes may go up in steps
        mean_dn = np.clip(
            converter.black_level_dn + converter.gain_dn_per_v * swing_v, 0.0, converter.highest
        )
    return _of_codes(levels, mean_dn, variance_dn2)
