"""Saturation of a camera, and the figures of EMVA 1288 Release 4.0 Linear: from the datasheet, not from frames."""

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
"""σ_q², variance of rounding to whole digital numbers (EMVA 1288 R4, section 2.2)."""
SERIAL, SIDE_PX, SAMPLED_PX = 2**30, 128, 256
"""Sensor unit whose dark noise is averaged over pixels, and the side of their window, in closed form and by samples: a
sampled σ is known to 0.3 %."""
APART = (0, 100_000)
"""Numbers of the two sampled frames, so far apart that a telegraph signal has forgotten its state."""
STRAIGHT = 1e-12  # of the range of codes: a chain is straight to the last digits


class Figure(NamedTuple):
    """One line of a table of figures.  section : of EMVA 1288 R4 Linear that defines it."""

    name: str
    symbol: str
    value: float
    unit: str
    section: str


@dataclass(frozen=True)
class EmvaFigures:
    """EMVA 1288 figures of one camera in one exposure, for any pixel of it: spatial noise has figures of its own.

    exposure : of the dark signal.
    system_gain_dn_per_e : K, overall system gain of small signals [DN/e-] (section 2.1).
    temporal_dark_noise_e : σ_d, temporal noise without light in front of the converter, as electrons. It includes read
        noise and dark shot noise, not the quantisation noise σ_q = √(1/12) DN (section 2.2).
    saturation_e : µ_e.sat, photoelectrons at which a pixel saturates: its full well, or less where the converter ends
        before, less the mean dark electrons of this exposure (section 2.4).
    absolute_sensitivity_e : µ_e.min, photoelectrons whose signal equals their noise, √(σ_d² + σ_q²/K² + ¼) + ½ (2.4).
    snr_max : √µ_e.sat, with shot noise alone (2.4).  dynamic_range : DR = µ_e.sat/µ_e.min; the QE cancels (2.4).

    With an EM gain electrons are those of the pixel, and its excess noise F² is in µ_e.min = √(σ_d² + σ_q²/K² + F⁴/4) +
    F²/2 and SNR_max = √(µ_e.sat/F²).

    A camera without shot noise has the same SNR without its variance: µ_e.min = √(σ_d² + σ_q²/K²), and the largest SNR
    is the dynamic range. Photons are electrons over the QE: ``figures.saturation_e / camera.qe([550.0])``.
    """

    exposure: Exposure
    system_gain_dn_per_e: float
    temporal_dark_noise_e: float
    saturation_e: float
    absolute_sensitivity_e: float
    snr_max: float
    dynamic_range: float

    def __repr__(self) -> str:
        shown = ", ".join(f"{one.symbol} {one.value:.4g} {one.unit}" for one in self.table())
        return f"<EmvaFigures: {shown}>"

    def _repr_html_(self) -> str:
        rows = [
            (one.name, one.symbol, f"{one.value:.4g}", one.unit, one.section)
            for one in self.table()
        ]
        heading = "figure", "symbol", "value", "unit", "section"
        return fragment("EMVA 1288 figures of the datasheet", Table(heading, rows))

    @property
    def snr_max_db(self) -> float:
        """20·log10 of SNR_max [dB]."""
        return _db(self.snr_max)

    @property
    def dynamic_range_db(self) -> float:
        """20·log10 of the dynamic range [dB]."""
        return _db(self.dynamic_range)

    def table(self) -> tuple[Figure, ...]:
        """Name, symbol, value, unit and section of every figure."""
        return (
            Figure("overall system gain", "K", self.system_gain_dn_per_e, "DN/e-", "2.1"),
            Figure("temporal dark noise", "σ_d", self.temporal_dark_noise_e, "e- rms", "2.2"),
            Figure("saturation capacity", "µ_e.sat", self.saturation_e, "e-", "2.4"),
            Figure(
                "absolute sensitivity threshold",
                "µ_e.min",
                self.absolute_sensitivity_e,
                "e-",
                "2.4",
            ),
            Figure("maximum SNR", "SNR_max", self.snr_max_db, "dB", "2.4"),
            Figure("dynamic range", "DR", self.dynamic_range_db, "dB", "2.4"),
        )

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            **asdict(self),
            "snr_max_db": self.snr_max_db,
            "dynamic_range_db": self.dynamic_range_db,
        }


def emva_figures(camera: Camera, exposure: Exposure) -> EmvaFigures:
    """The figures of a camera. Raises InputError where darkness is at the highest code."""
    check_types(camera, exposure)
    refuse_readouts(camera, "EMVA 1288's figures are those of one read-out")
    if camera.pixel.partial_resets:
        raise InputError(
            f"{camera.name} has pixel.partial_resets, and EMVA 1288's figures are those of a straight response; unset "
            "pixel.partial_resets."
        )
    gain, stages = gain_dn_per_e(camera), camera.stages
    dark_e, noise_e = _dark_signal(camera, exposure)
    full_e = max(saturation_e(camera) - dark_e, 0.0)
    shot = 0.0  # variance of one photoelectron
    if place_of_count(stages):
        shot = excess_noise(camera)
    still_e = math.sqrt(noise_e**2 + QUANTISATION_DN2 / gain**2)
    least_e = math.sqrt(still_e**2 + shot**2 / 4) + shot / 2
    if shot:
        snr_max = math.sqrt(full_e / shot)
    else:
        snr_max = full_e / still_e
    return EmvaFigures(exposure, gain, noise_e, full_e, least_e, snr_max, full_e / least_e)


def _dark_signal(camera: Camera, exposure: Exposure) -> tuple[float, float]:
    """Mean dark electrons of a pixel, and the temporal noise in front of the converter as electrons of the pixel.

    In closed form over the pixels for a straight chain, which is exact where all are alike; else by two frames.
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
    for index in APART:
        one = replace(frame, index=index, _blocks={})
        charge = sample(well, dark, one)
        electrons.append(float(np.mean(charge.total)))
        swings.append(sample(stages[len(well) + 1 : -1], charge, one))
    noise_v = math.sqrt(float(np.mean((swings[0] - swings[1]) ** 2)) / 2)
    multiplied = math.prod(stage.nominal_gain for stage in well)
    return sum(electrons) / 2 / multiplied, noise_v * converter_of(stages).gain_dn_per_v / gain


def _flat(read_noise_e: float) -> dict[str, Any]:
    """Maps without spatial noise, which has figures of its own."""
    flat = np.zeros((1, 1))
    dsnu = dict.fromkeys(("dsnu_pixel_e", "dsnu_col_e", "dsnu_row_e"), flat)
    return dsnu | {"prnu": flat + 1, "prnu_col": flat + 1, "read_noise": flat + read_noise_e}


def refuse_readouts(
    camera: Camera, why: str, way_out: str = "camera.at_readout (--readout)"
) -> None:
    """Raise InputError for a camera with several read-outs.

    why : what there is of one read-out only.  way_out : what one of them is taken from.
    """
    if not camera.readouts:
        return
    names = ", ".join(one.name for one in camera.readouts)
    raise InputError(
        f"{camera.name} has the read-outs {names}, and {why}; take one of them by its name, from {way_out}, or "
        "the camera without its table of read-outs (--set readouts=none)."
    )


def figures_if_any(camera: Camera) -> EmvaFigures | None:
    """Those of a short exposure; None for a camera that has no range of codes for light."""
    with suppress(InputError):
        return emva_figures(camera, Exposure(0.0))
    return None


def _db(ratio: float) -> float:
    if ratio > 0:
        return 20 * math.log10(ratio)
    return -math.inf


BEYOND_ALL_DN = 1e12
"""A code beyond every converter, where a curve has left all numbers."""


def saturation_e(camera: Camera) -> float:
    """Electrons at which a pixel saturates: its full well, or less where the converter ends before."""
    full_well_e = _smallest_well_e(camera)
    dark_dn, full_dn = (
        _beyond_converter_dn(electrons, camera) for electrons in (0.0, full_well_e)
    )
    if full_dn <= 0:
        return full_well_e
    if dark_dn >= 0:
        raise InputError(
            f"darkness is at the highest code of {camera.name}; give adc.black_level_dn a smaller value."
        )
    straight_e = full_well_e * dark_dn / (dark_dn - full_dn)
    if abs(_beyond_converter_dn(straight_e, camera)) < STRAIGHT * (full_dn - dark_dn):
        return straight_e
    return root(lambda electrons: _beyond_converter_dn(electrons, camera), 0.0, full_well_e)


def metered_saturation_e(camera: Camera) -> float:
    """Electrons at which a pixel saturates that is metered: of several read-outs the most sensitive one."""
    combined = combined_of(camera.stages)
    if combined is None:
        return saturation_e(camera)
    return saturation_e(camera.readout_cameras[combined.readouts[0].name])


def saturation_dn(camera: Camera) -> int:
    """The code of a saturated pixel: that of a full well, above the black level and at most the highest [DN]."""
    converter = converter_of(camera.stages)
    above_dark_dn = max(round(full_well_dn(camera)), math.floor(converter.black_level_dn) + 1)
    return min(converter.highest, above_dark_dn)


def full_well_dn(camera: Camera) -> float:
    """The code that a full well would have if the converter did not end [DN]."""
    converter = converter_of(camera.stages)
    return converter.highest + _beyond_converter_dn(_smallest_well_e(camera), camera)


def _smallest_well_e(camera: Camera) -> float:
    """Electrons in the pixel that fill its well, or the register behind it; of several read-outs those that saturate
    the least sensitive one."""
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


def _beyond_converter_dn(electrons: float, camera: Camera) -> float:
    """The code of these electrons without any noise, its curves included, less the highest one [DN]."""
    left_e = left_by_resets(camera.pixel.partial_resets, electrons)
    window = SensorWindow(0, (1, 1), given=_flat(0.0))
    quiet = QuietFrame.of(Frame(BLACK_LEVEL_AT, window))
    signal = Electrons(np.full((1, 1), left_e))
    for stage in camera.stages[1:-1]:
        if stage.domain == "electrons":
            signal = Electrons(signal.light * stage.nominal_gain)
        else:
            with suppress(NotStraight):  # noise alone
                signal = stage.sample(signal, quiet)
    converter = converter_of(camera.stages)
    beyond_dn = float(
        converter.black_level_dn
        + converter.gain_dn_per_v * np.mean(total(signal))
        - converter.highest
    )
    if math.isfinite(beyond_dn):
        return beyond_dn
    return BEYOND_ALL_DN
