"""Saturation and EMVA 1288 Release 4.0 Linear parameters of a camera, computed from its datasheet."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core import Electrons, Exposure, Frame, InputError, SensorWindow, check_types
from ..core.html import Table, fragment
from ..core.special import root
from ..stages.combined_readouts import combined_of
from ..stages.effects.adc import BLACK_LEVEL_AT
from ..stages.effects.shot_noise import left_by_resets
from ..stages.effects.source_follower_noise import read_noise_v
from ..stages.gains import excess_noise, gain_dn_per_e, sense_gain_v_per_e
from ..stages.stage import converter_of, place_of_count, sample, total
from ..stages.straight import NotStraight, QuietFrame, line_of

if TYPE_CHECKING:
    from .camera import Camera

QUANTISATION_DN2 = 1 / 12
"""σ_q², variance of rounding to integer DN (EMVA 1288 R4, section 2.2)."""
SERIAL, SIDE_PX, SAMPLED_PX = 2**30, 128, 256
"""Sensor unit whose dark noise is averaged over pixels, and the side of their window for the closed form and for
samples (which give σ to 0.3 %)."""
FRAME_NUMBERS = (0, 100_000)
"""Numbers of the two sampled frames, far enough apart that telegraph signals are uncorrelated."""
LINEAR_TOLERANCE = 1e-12  # of the range of codes


class Figure(NamedTuple):
    """A row of a table of parameters.  section : of EMVA 1288 R4 Linear that defines it."""

    name: str
    symbol: str
    value: float
    unit: str
    section: str


@dataclass(frozen=True)
class EmvaFigures:
    """EMVA 1288 parameters of a camera at one exposure, without spatial noise.

    exposure : sets the dark signal.
    system_gain_dn_per_e : K, overall system gain of small signals [DN/e-] (section 2.1).
    temporal_dark_noise_e : σ_d, temporal dark noise before the ADC, in electrons. It includes read noise and dark shot
        noise, but not the quantisation noise σ_q = √(1/12) DN (section 2.2).
    saturation_e : µ_e.sat, photoelectrons at saturation of the full well or ADC, whichever saturates first, minus the
        mean dark electrons of this exposure (section 2.4).
    absolute_sensitivity_e : µ_e.min, photoelectrons whose signal equals their noise, √(σ_d² + σ_q²/K² + ¼) + ½ (2.4).
    snr_max : √µ_e.sat, from shot noise alone (2.4).  dynamic_range : DR = µ_e.sat/µ_e.min; the QE cancels (2.4).

    With EM gain, electrons are counted in the pixel. The excess noise F² enters µ_e.min = √(σ_d² + σ_q²/K² + F⁴/4) +
    F²/2 and SNR_max = √(µ_e.sat/F²).

    Without shot noise, µ_e.min = √(σ_d² + σ_q²/K²) and SNR_max equals the dynamic range. Divide electrons by the QE to
    obtain photons: ``figures.saturation_e / camera.qe([550.0])``.
    """

    exposure: Exposure
    system_gain_dn_per_e: float
    temporal_dark_noise_e: float
    saturation_e: float
    absolute_sensitivity_e: float
    snr_max: float
    dynamic_range: float

    def __repr__(self) -> str:
        shown = ", ".join(f"{x.symbol} {x.value:.4g} {x.unit}" for x in self.table())
        return f"<EmvaFigures: {shown}>"

    def _repr_html_(self) -> str:
        rows = [(x.name, x.symbol, f"{x.value:.4g}", x.unit, x.section) for x in self.table()]
        heading = "parameter", "symbol", "value", "unit", "section"
        return fragment("EMVA 1288 parameters of the datasheet", Table(heading, rows))

    @property
    def snr_max_db(self) -> float:
        """SNR_max [dB]."""
        return _db(self.snr_max)

    @property
    def dynamic_range_db(self) -> float:
        """Dynamic range [dB]."""
        return _db(self.dynamic_range)

    def table(self) -> tuple[Figure, ...]:
        """Return name, symbol, value, unit and section of every parameter."""
        least_e = self.absolute_sensitivity_e
        return (
            Figure("overall system gain", "K", self.system_gain_dn_per_e, "DN/e-", "2.1"),
            Figure("temporal dark noise", "σ_d", self.temporal_dark_noise_e, "e- rms", "2.2"),
            Figure("saturation capacity", "µ_e.sat", self.saturation_e, "e-", "2.4"),
            Figure("absolute sensitivity threshold", "µ_e.min", least_e, "e-", "2.4"),
            Figure("maximum SNR", "SNR_max", self.snr_max_db, "dB", "2.4"),
            Figure("dynamic range", "DR", self.dynamic_range_db, "dB", "2.4"),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters for JSON."""
        decibels = {"snr_max_db": self.snr_max_db, "dynamic_range_db": self.dynamic_range_db}
        return {**asdict(self), **decibels}


def emva_figures(camera: Camera, exposure: Exposure) -> EmvaFigures:
    """Return the EMVA 1288 parameters of a camera. Raises InputError if the dark signal saturates the ADC."""
    check_types(camera, exposure)
    refuse_readouts(camera, "EMVA 1288 parameters describe a single readout")
    if camera.pixel.partial_resets:
        raise InputError(
            f"{camera.name} has pixel.partial_resets, but EMVA 1288 parameters need a linear response; unset "
            "pixel.partial_resets."
        )
    gain, stages = gain_dn_per_e(camera), camera.stages
    dark_e, noise_e = _dark_signal(camera, exposure)
    full_e = max(saturation_e(camera) - dark_e, 0.0)
    shot = excess_noise(camera) if place_of_count(stages) else 0.0  # variance per photoelectron
    still_e = math.sqrt(noise_e**2 + QUANTISATION_DN2 / gain**2)
    least_e = math.sqrt(still_e**2 + shot**2 / 4) + shot / 2
    snr_max = math.sqrt(full_e / shot) if shot else full_e / still_e
    return EmvaFigures(exposure, gain, noise_e, full_e, least_e, snr_max, full_e / least_e)


def _dark_signal(camera: Camera, exposure: Exposure) -> tuple[float, float]:
    """Return the mean dark electrons of a pixel, and the temporal noise before the ADC in electrons of the pixel.

    A straight chain has a closed form, which is exact for equal pixels; other chains are sampled in two frames.
    """
    stages, gain = camera.stages, gain_dn_per_e(camera)
    flat = _flat(read_noise_v(camera) / sense_gain_v_per_e(camera))

    def darkness(side: int) -> tuple[Electrons, Frame]:
        window = SensorWindow(SERIAL, (side, side), camera=camera.name, given=flat)
        return Electrons(np.zeros((side, side))), Frame(exposure, window)

    with suppress(NotStraight):
        line = line_of(stages, *darkness(SIDE_PX))
        shot_dn2 = line.slope**2 * line.rate_e if line.counted else 0.0
        noise_dn = math.sqrt(float(np.mean(line.sigma_dn**2 + shot_dn2)))
        return float(np.mean(line.rate_e)), noise_dn / gain
    well = [stage for stage in stages[1:-1] if stage.domain == "electrons"]
    dark, frame = darkness(SAMPLED_PX)
    electrons, swings = [], []
    for index in FRAME_NUMBERS:
        numbered = replace(frame, index=index, _blocks={})
        charge = sample(well, dark, numbered)
        electrons.append(float(np.mean(charge.total)))
        swings.append(sample(stages[len(well) + 1 : -1], charge, numbered))
    noise_v = math.sqrt(float(np.mean((swings[0] - swings[1]) ** 2)) / 2)
    multiplied = math.prod(stage.nominal_gain for stage in well)
    return sum(electrons) / 2 / multiplied, noise_v * converter_of(stages).gain_dn_per_v / gain


def _flat(read_noise_e: float) -> dict[str, Any]:
    """Return maps without spatial noise."""
    flat = np.zeros((1, 1))
    dsnu = dict.fromkeys(("dsnu_pixel_e", "dsnu_col_e", "dsnu_row_e"), flat)
    return dsnu | {"prnu": flat + 1, "prnu_col": flat + 1, "read_noise": flat + read_noise_e}


def refuse_readouts(
    camera: Camera, reason: str, remedy: str = "camera.at_readout({name!r})"
) -> None:
    """Raise InputError for a camera with several readouts.  remedy : how to take the readout ``name``."""
    if camera.readouts:
        names = [readout.name for readout in camera.readouts]
        raise InputError(
            f"{camera.name} has the readouts {', '.join(names)}, but {reason}; use {remedy.format(name=names[0])}."
        )


def figures_if_any(camera: Camera) -> EmvaFigures | None:
    """Return the parameters at zero exposure, or None if the camera has none."""
    with suppress(InputError):
        return emva_figures(camera, Exposure(0.0))
    return None


def _db(ratio: float) -> float:
    return 20 * math.log10(ratio) if ratio > 0 else -math.inf


OVERFLOW_DN = 1e12
"""Code above every full scale, if a response curve is not finite."""


def saturation_e(camera: Camera) -> float:
    """Return the electrons at which a pixel saturates: its full well, or fewer if the ADC saturates first."""
    full_well_e = _smallest_well_e(camera)
    dark_dn, full_dn = (_above_full_scale_dn(x, camera) for x in (0.0, full_well_e))
    if full_dn <= 0:
        return full_well_e
    if dark_dn >= 0:
        raise InputError(
            f"the black level of {camera.name} is at or above full scale; reduce adc.black_level_dn."
        )
    straight_e = full_well_e * dark_dn / (dark_dn - full_dn)
    if abs(_above_full_scale_dn(straight_e, camera)) < LINEAR_TOLERANCE * (full_dn - dark_dn):
        return straight_e
    return root(lambda electrons: _above_full_scale_dn(electrons, camera), 0.0, full_well_e)


def metered_saturation_e(camera: Camera) -> float:
    """Return the electrons at which a metered pixel saturates: in the most sensitive of several readouts."""
    combined = combined_of(camera.stages)
    if combined is None:
        return saturation_e(camera)
    return saturation_e(camera.readout_cameras[combined.readouts[0].name])


def saturation_dn(camera: Camera) -> int:
    """Return the code of a saturated pixel: full well, but above the black level and at most full scale [DN]."""
    converter = converter_of(camera.stages)
    above_dark_dn = max(round(full_well_dn(camera)), math.floor(converter.black_level_dn) + 1)
    return min(converter.highest, above_dark_dn)


def full_well_dn(camera: Camera) -> float:
    """Return the code of a full well in an ADC without full scale [DN]."""
    converter = converter_of(camera.stages)
    return converter.highest + _above_full_scale_dn(_smallest_well_e(camera), camera)


def _smallest_well_e(camera: Camera) -> float:
    """Return the electrons that fill the pixel's well or register, in the least sensitive of several readouts."""
    combined = combined_of(camera.stages)
    if combined is not None:
        last = combined.readouts[-1]
        return saturation_e(camera.readout_cameras[last.name]) / last.light_ratio
    filled_e = float(camera.pixel.full_well_e)
    for stage in camera.stages[1:-1]:
        if stage.saturation_e is not None:
            filled_e = min(filled_e, stage.saturation_e / stage.nominal_gain)
    if not camera.pixel.partial_resets:
        return filled_e
    resets = camera.pixel.partial_resets
    most_e = filled_e / (1 - resets[-1][0])
    return root(lambda electrons: left_by_resets(resets, electrons) - filled_e, 0.0, most_e)


def _above_full_scale_dn(electrons: float, camera: Camera) -> float:
    """Return the noise-free code of these electrons minus the full-scale code [DN]."""
    left_e = left_by_resets(camera.pixel.partial_resets, electrons)
    window = SensorWindow(0, (1, 1), given=_flat(0.0))
    quiet = QuietFrame.of(Frame(BLACK_LEVEL_AT, window))
    signal = Electrons(np.full((1, 1), left_e))
    for stage in camera.stages[1:-1]:
        if stage.domain == "electrons":
            signal = Electrons(signal.light * stage.nominal_gain)
        else:
            with suppress(NotStraight):  # a stage of noise only
                signal = stage.sample(signal, quiet)
    converter = converter_of(camera.stages)
    code_dn = converter.black_level_dn + converter.gain_dn_per_v * np.mean(total(signal))
    above_dn = float(code_dn - converter.highest)
    return above_dn if math.isfinite(above_dn) else OVERFLOW_DN
