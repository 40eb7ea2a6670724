"""chain(camera): the stages in the order in which the electrons meet them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

from ..engine.frame import Device, Exposure, Frame
from ..engine.moments import Moments
from .camera import Camera
from .cds import CdsNoise
from .digital import Adc
from .electrons import DarkCurrent, Detection, FullWell, Prnu, ShotNoise
from .laws import Doubling, FigureOfMerit
from .patterns import GaussianMap, LogNormalMap
from .volts import CdsGain, ColumnOffset, ResetNoise, SenseNode, SourceFollower, SourceFollowerNoise

RESET_RESIDUAL = {"hard": 1.0, "soft": math.sqrt(0.5), "true_cds": 0.0}
"""What is left of the kTC noise (paper, sense node reset noise; soft reset: Pain et al. 2000)."""

PATTERNS: dict[str, Callable[[float], Any]] = {"gaussian": GaussianMap, "lognormal": LogNormalMap}

PEDESTAL_AT = Exposure(time_s=0.0, temperature_k=298.15)
"""The default pedestal holds the noise of this exposure."""


class Stage(Protocol):
    """A room's step: one random frame, and the moments that it must have."""

    @property
    def room(self) -> str: ...
    def __call__(self, signal: Any, frame: Frame) -> Any: ...
    def moments(self, m: Moments) -> Moments: ...


def chain(camera: Camera) -> tuple[Any, ...]:
    """The stages of this camera, from photons to digital numbers. A CCD has no reset noise and no column offsets."""
    return (
        Detection(camera.curves, camera.tile, camera.quantum_efficiency.reference_nm),
        Prnu(camera.pixel.prnu),
        DarkCurrent(dark_law(camera), PATTERNS[camera.dark_current.pattern](camera.dark_current.cv)),
        ShotNoise(),
        FullWell(camera.pixel.full_well_e),
        *analogue(camera),
        Adc(camera.adc.bits, adc_gain_dn_per_v(camera), pedestal_dn(camera)),
    )


def analogue(camera: Camera) -> tuple[Any, ...]:
    """The stages between the well and the converter."""
    gain = camera.readout.sense_gain_uv_per_e * 1e-6
    follower = camera.source_follower
    node = (SenseNode(gain),)
    noise = (SourceFollowerNoise(follower_sigma_v(camera)), SourceFollower(follower.gain))
    if camera.sensor.technology == "ccd":
        return (*node, *noise, CdsGain(camera.readout.cds_gain))
    columns = camera.readout.column_offset * camera.pixel.full_well_e * gain * follower.gain
    return (
        *node,
        ResetNoise(gain, RESET_RESIDUAL[camera.readout.reset]),
        *noise,
        ColumnOffset(columns, camera.readout.column_coupling),
        CdsGain(camera.readout.cds_gain),
    )


def dark_law(camera: Camera) -> FigureOfMerit | Doubling:
    """How this camera's dark current follows the temperature."""
    dark = camera.dark_current
    if dark.fom_na_per_cm2 is not None:
        return FigureOfMerit(dark.fom_na_per_cm2, camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-8)
    return Doubling(dark.rate_e_per_s, dark.at_temperature_k, dark.doubling_k)  # type: ignore[arg-type]


def follower_sigma_v(camera: Camera) -> float:
    """Noise of the source follower at the sense node [V rms]. A CCD has one amplifier and no telegraph noise."""
    follower = camera.source_follower
    if follower.read_noise_e is not None:
        return follower.read_noise_e * camera.readout.sense_gain_uv_per_e * 1e-6
    noise = CdsNoise(
        white_nv_per_rthz=follower.white_nv_per_rthz or 0.0,
        corner_hz=follower.corner_hz,
        sample_s=follower.cds_sample_s,
        dominant_s=follower.cds_dominant_s,
        rtn_uv=0.0 if camera.sensor.technology == "ccd" else follower.rtn_uv,
        rtn_s=follower.rtn_s,
    )
    return noise.sigma_v / follower.gain


def full_scale_v(camera: Camera) -> float:
    """V_FS, the swing that fills the code range [V]; the swing of a full well unless the datasheet says otherwise."""
    if camera.adc.full_scale_v is not None:
        return camera.adc.full_scale_v
    return camera.pixel.full_well_e * volts_per_electron(camera)


def volts_per_electron(camera: Camera) -> float:
    """A_SN·A_SF·A_CDS [V/e-]."""
    return camera.readout.sense_gain_uv_per_e * 1e-6 * camera.source_follower.gain * camera.readout.cds_gain


def adc_gain_dn_per_v(camera: Camera) -> float:
    """A = 2^bits/V_FS [DN/V]."""
    return 2.0**camera.adc.bits / full_scale_v(camera)


def gain_dn_per_e(camera: Camera) -> float:
    """EMVA 1288's overall system gain K = A_SN·A_SF·A_CDS·2^bits/V_FS [DN/e-]."""
    return volts_per_electron(camera) * adc_gain_dn_per_v(camera)


def pedestal_dn(camera: Camera) -> float:
    """What darkness reads: as given, else 4σ of a zero exposure, rounded up, but never above 1/8 of the range [DN]."""
    if camera.adc.pedestal_dn is not None:
        return camera.adc.pedestal_dn
    m = Moments(0.0, 0.0, 0.0, Frame(PEDESTAL_AT, Device(0, (1, 1))))
    for stage in analogue(camera):
        m = stage.moments(m)
    sigma = math.hypot(m.sigma * adc_gain_dn_per_v(camera), math.sqrt(1 / 12))
    return float(min(math.ceil(4 * sigma), (2**camera.adc.bits - 1) // 8))
