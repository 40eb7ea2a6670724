"""Dynamic range of a camera with several readouts by EMVA 1288 and ISO 15739, from samples of its codes."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from ..camera.camera import Camera
from ..camera.figures import saturation_e
from ..core import Electrons, Exposure, Frame, SensorWindow
from ..stages.stage import Chain, sample
from .expected import FIRST_SEED, FIRST_SERIAL

SHAPE = (128, 256)
"""Pixels of a frame at each exposure level; two frames give the noise within 0.4 %, 0.03 dB."""

ROUNDS = 8
"""Iterations to find the light whose SNR is 1."""


@dataclass(frozen=True)
class HdrFigures:
    """Dynamic range of combined readouts with temporal noise only.

    saturation_e : photoelectrons of the frame's exposure at which the least sensitive readout saturates.
    absolute_sensitivity_e : photoelectrons whose SNR is 1, μ_e.min of EMVA 1288.
    dark_noise_e : temporal noise in the dark, including the rounding of codes [e- rms].
    dynamic_range_emva_db : saturation over absolute sensitivity (EMVA 1288 R4, section 2.4).
    dynamic_range_iso_db : saturation over the dark noise (ISO 15739).
    dips_db : loss of SNR where each readout switches to the next.
    Sampling 33 000 pixels gives each number a standard error of 0.05 dB or 0.5 %.
    """

    saturation_e: float
    absolute_sensitivity_e: float
    dark_noise_e: float
    dynamic_range_emva_db: float
    dynamic_range_iso_db: float
    dips_db: tuple[float, ...]

    def to_dict(self) -> dict[str, object]:
        """Return the metrics for JSON."""
        return asdict(self)


def hdr_figures(camera: Camera, exposure: Exposure) -> HdrFigures:
    """Return the metrics of a camera with several readouts in one exposure."""
    full_e, stages = saturation_e(camera), camera.stages
    stage, conditions = camera.combined_readouts, _conditions(exposure)
    dark_dn, dark_dn2 = code_at(stages, conditions, 0.0)
    dark_e = math.sqrt(dark_dn2) / stage.nominal_gain
    least_e = max(dark_e, 1e-6)
    for _ in range(ROUNDS):  # at the same random numbers
        mean_dn, variance_dn2 = code_at(stages, conditions, least_e)
        signal_dn = max(mean_dn - dark_dn, 1e-3 * least_e * stage.nominal_gain)
        least_e *= max(math.sqrt(variance_dn2), 1e-9) / signal_dn
    return HdrFigures(
        full_e,
        least_e,
        dark_e,
        20 * math.log10(full_e / least_e),
        20 * math.log10(full_e / max(dark_e, 1e-9)),
        tuple(_dips_db(camera, conditions)),
    )


def _dips_db(camera: Camera, conditions: Frame) -> list[float]:
    """Return the loss of SNR from each readout to the next, at the light where it switches [dB]."""
    combination, found = camera.combined_readouts.combination, list[float]()
    for number, linear in enumerate(combination.readouts[:-1]):
        end_e = (linear.end_dn - linear.black_dn) * linear.electrons_per_dn
        noise = [_noise_e(camera, conditions, number + step, end_e) for step in (0, 1)]
        found.append(20 * math.log10(max(noise[1], 1e-9) / max(noise[0], 1e-9)))
    return found


def _noise_e(camera: Camera, conditions: Frame, number: int, light_e: float) -> float:
    """Return the temporal noise of one readout in this light, both in electrons of the frame's exposure."""
    readout = camera.combined_readouts.readouts[number]
    own_e = readout.light_ratio * light_e
    _, variance = code_at(readout.stages, readout.frame_of(conditions), own_e)
    return camera.combined_readouts.combination.readouts[number].electrons_per_dn * math.sqrt(
        variance
    )


def code_at(stages: Chain, frame: Frame, light_e: float) -> tuple[float, float]:
    """Return mean [DN] and temporal variance [DN²] of the code for this mean of photoelectrons per pixel."""
    window = replace(frame.window, shape=SHAPE, _maps={}, _tiles={})
    first, second = (
        np.asarray(
            sample(
                stages[1:],
                Electrons(np.full(SHAPE, light_e)),
                replace(frame, window=window, seed=FIRST_SEED + number, _blocks={}),
            ),
            np.float64,
        )
        for number in (0, 1)
    )
    return float((first.mean() + second.mean()) / 2), float(((first - second) ** 2).mean() / 2)


def _conditions(exposure: Exposure) -> Frame:
    return Frame(exposure, SensorWindow(FIRST_SERIAL, SHAPE))
