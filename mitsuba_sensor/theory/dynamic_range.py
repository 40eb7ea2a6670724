"""Dynamic range of a camera with several read-outs, by EMVA 1288 and by ISO 15739, from mean and noise of its code."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from ..camera.camera import Camera
from ..camera.figures import saturation_e
from ..core import Exposure, Frame, SensorWindow
from ..core.types import Float64Array
from .combined_theory import codes_by_light
from .response import behind_stages_at

LEVELS = 400
"""Levels of light, evenly spaced in their logarithm, at which the SNR is looked at."""
DARKEST_E = 0.01
SATURATED = 0.98
"""Share of saturation up to which the SNR is looked at."""


@dataclass(frozen=True)
class HdrFigures:
    """What a combination of read-outs can tell apart, temporal noise alone.

    saturation_e : photoelectrons of the frame's exposure at which the least sensitive read-out saturates.
    absolute_sensitivity_e : photoelectrons whose SNR is 1, EMVA 1288's µ_e.min.
    dark_noise_e : temporal noise in darkness, the rounding of the codes included.
    dynamic_range_emva_db : saturation over absolute sensitivity (EMVA 1288 R4, section 2.4).
    dynamic_range_iso_db : ISO 15739: saturation over the light whose signal, by the gain at black, equals the temporal
        noise of black.
    dips_db : by how much the SNR falls where each read-out hands over to the next.
    """

    saturation_e: float
    absolute_sensitivity_e: float
    dark_noise_e: float
    dynamic_range_emva_db: float
    dynamic_range_iso_db: float
    dips_db: tuple[float, ...]

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        return asdict(self)


def snr_by_light(camera: Camera, exposure: Exposure, light_e: Float64Array) -> Float64Array:
    """Mean of the linear code over that of darkness, over its temporal noise, by mean photoelectrons, (L,)."""
    levels = np.concatenate([[0.0], light_e])
    mean, variance = codes_by_light(camera.combined_readouts, _conditions(exposure), levels)
    signal = np.maximum(mean[1:] - mean[0], 0.0)
    sigma = np.sqrt(variance[1:])
    return np.asarray(np.divide(signal, sigma, out=np.zeros(signal.shape), where=sigma > 0))


def hdr_figures(camera: Camera, exposure: Exposure) -> HdrFigures:
    """The figures of a camera with several read-outs in one exposure."""
    full_e = saturation_e(camera)
    levels = np.geomspace(DARKEST_E, SATURATED * full_e, LEVELS)
    snr = snr_by_light(camera, exposure, levels)
    first = max(int(np.argmax(snr >= 1)), 1)
    least_e = float(np.interp(1.0, snr[first - 1 : first + 1], levels[first - 1 : first + 1]))
    stage = camera.combined_readouts
    _, dark_dn2 = codes_by_light(stage, _conditions(exposure), np.zeros(1))
    dark_e = math.sqrt(float(dark_dn2[0])) / stage.nominal_gain
    return HdrFigures(
        full_e,
        least_e,
        dark_e,
        20 * math.log10(full_e / least_e),
        20 * math.log10(full_e / max(dark_e, 1e-9)),
        tuple(_dips_db(camera, exposure)),
    )


def _dips_db(camera: Camera, exposure: Exposure) -> list[float]:
    """By how much the SNR is smaller behind each hand-over than the read-out before would have had."""
    combination, found = camera.combined_readouts.combination, list[float]()
    for number, linear in enumerate(combination.readouts[:-1]):
        end_e = np.array([(linear.end_dn - linear.black_dn) * linear.electrons_per_dn])
        noise = [_noise_e(camera, exposure, number + step, end_e) for step in (0, 1)]
        found.append(20 * math.log10(noise[1] / noise[0]))
    return found


def _noise_e(camera: Camera, exposure: Exposure, number: int, light_e: Float64Array) -> float:
    """Temporal noise of one read-out in this light of the frame's exposure, as electrons of it."""
    readout = camera.combined_readouts.readouts[number]
    frame = readout.frame_of(_conditions(exposure))
    last = len(readout.stages) - 1
    _, variance = behind_stages_at(
        readout.stages, frame, readout.light_ratio * light_e, [last]
    )[last]
    per_dn_e = camera.combined_readouts.combination.readouts[number].electrons_per_dn
    return per_dn_e * math.sqrt(float(variance[0]))


def _conditions(exposure: Exposure) -> Frame:
    return Frame(exposure, SensorWindow(0, (1, 1)))
