"""chain(camera): the stages in the order in which the electrons meet them."""

from __future__ import annotations

import math
from typing import Any, Protocol

from ..core.exposure import Exposure
from ..core.frame import Frame
from ..core.moments import Moments
from ..core.sensor_window import SensorWindow
from ..core.units import ELEMENTARY_CHARGE_C
from .camera import Camera
from .cds import CdsNoise
from .dark_components import DarkComponent
from .dark_current_models import Doubling, FigureOfMerit, Measured, Mpp
from .digital import Adc, AdcWithSteps, IntegralNonlinearity, gamma_of_ile
from .electrons import DarkCurrent, Detection, FullWell, Prnu, QeCurve, QuantumYield, RtsPixels, ShotNoise
from .fpn_distributions import (
    Autoregressive,
    AutoregressiveRectified,
    FpnDistribution,
    Gamma,
    Gaussian,
    Logistic,
    LogNormal,
    Rectified,
    Wald,
)
from .volts import (
    CdsGain,
    DsnuColumn,
    DsnuPixel,
    DsnuRow,
    NonlinearSenseNode,
    NonlinearSourceFollower,
    PrnuColumn,
    ResetNoise,
    SenseNode,
    SourceFollower,
    SourceFollowerNoise,
)

RESET_RESIDUAL = {"hard": 1.0, "soft": math.sqrt(0.5), "true_cds": 0.0}
"""What is left of the kTC noise (paper, sense node reset noise; soft reset: Pain et al. 2000)."""

PRNU_DISTRIBUTIONS: dict[str, Any] = {"gaussian": Rectified, "lognormal": LogNormal}
DARK_DISTRIBUTIONS: dict[str, Any] = {
    "gaussian": Gaussian,
    "lognormal": LogNormal,
    "gamma": Gamma,
    "wald": Wald,
    "logistic": Logistic,
}

BLACK_LEVEL_AT = Exposure(time_s=0.0, temperature_k=298.15)
"""The default pedestal holds the noise of this exposure."""


class Stage(Protocol):
    """A room's step: one random frame, and the moments that it must have."""

    @property
    def domain(self) -> str: ...
    def __call__(self, signal: Any, frame: Frame) -> Any: ...
    def moments(self, m: Moments) -> Moments: ...


def chain(camera: Camera) -> tuple[Any, ...]:
    """The stages of this camera, from photons to digital numbers. A CCD has no reset noise and no column offsets."""
    return (
        *collection(camera),
        FullWell(camera.pixel.full_well_e),
        *analogue(camera),
        converter(camera),
    )


def collection(camera: Camera) -> tuple[Any, ...]:
    """The stages before the well: what frees electrons."""
    section, dark = camera.quantum_efficiency, camera.dark_current
    burst = QeCurve(section.wavelengths_nm, section.quantum_yield) if section.quantum_yield else None
    return (
        Detection(camera.curves, camera.tile, section.reference_nm, burst),
        Prnu(prnu_distribution(camera)),
        DarkCurrent(dark_current_model(camera), dark_fpn(camera), dark_components(camera)),
        *((_blinking(camera),) if dark.rts_fraction else ()),
        ShotNoise(),
        *((QuantumYield(section.fano_factor),) if burst else ()),
    )


def analogue(camera: Camera) -> tuple[Any, ...]:
    """The stages between the well and the converter."""
    readout, follower = camera.readout, camera.source_follower
    gain, full_well_e = sense_gain_v_per_e(camera), camera.pixel.full_well_e
    noise = (SourceFollowerNoise(follower_sigma_v(camera)), _follower(camera))
    ending = (CdsGain(readout.cds_gain), *_integral(camera))
    if camera.sensor.technology == "ccd":
        return (_node(camera), *noise, *ending)
    per_e, left = gain * follower.gain, readout.dsnu_residual
    residual = RESET_RESIDUAL[readout.reset] if readout.ktc_residual is None else readout.ktc_residual
    return (
        _node(camera),
        ResetNoise(gain, residual),
        *noise,
        DsnuColumn(readout.dsnu_col * full_well_e, per_e, readout.dsnu_col_coupling, left),
        DsnuRow(readout.dsnu_row * full_well_e, per_e, readout.dsnu_row_coupling),
        DsnuPixel(camera.pixel.dsnu_e, per_e, camera.pixel.dsnu_coupling, left),
        PrnuColumn(readout.prnu_col, readout.prnu_col_coupling),
        *ending,
    )


def converter(camera: Camera) -> Adc:
    """The ADC, with steps of its own where the datasheet has a DNL table."""
    plain = (camera.adc.bits, adc_gain_dn_per_v(camera), black_level_dn(camera))
    if not camera.adc.dnl_lsb:
        return Adc(*plain)
    table = [0.0] * 2**camera.adc.bits
    for code, width in camera.adc.dnl_lsb.items():
        table[int(code)] = width
    return AdcWithSteps(*plain, dnl_lsb=tuple(table))


def prnu_distribution(camera: Camera) -> FpnDistribution:
    """Family of the gain pattern."""
    pixel = camera.pixel
    if pixel.prnu_distribution == "ar":
        return AutoregressiveRectified(pixel.prnu, pixel.prnu_coupling)
    return PRNU_DISTRIBUTIONS[pixel.prnu_distribution](pixel.prnu)


def mean_dark_e(camera: Camera, exposure: Exposure) -> float:
    """Mean dark electrons of a pixel of the main part in one exposure."""
    return exposure.time_s * dark_current_model(camera).rate_e_per_s(exposure.temperature_k)


def dark_fpn(camera: Camera) -> FpnDistribution:
    """Family of the dark pattern."""
    dark = camera.dark_current
    if dark.distribution == "ar":
        return Autoregressive(dark.cv, dark.coupling)
    return DARK_DISTRIBUTIONS[dark.distribution](dark.cv)


def dark_current_model(camera: Camera) -> FigureOfMerit | Mpp | Doubling | Measured:
    """How this camera's dark current follows the temperature."""
    dark = camera.dark_current
    area_cm2 = camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-8
    if dark.fom_na_per_cm2 is not None:
        if dark.diffusion_fom_na_per_cm2 is not None:
            return Mpp(dark.diffusion_fom_na_per_cm2, dark.fom_na_per_cm2, area_cm2)
        return FigureOfMerit(dark.fom_na_per_cm2, area_cm2)
    rate, at = dark.rate_e_per_s or 0.0, dark.at_temperature_k or 300.0
    return Measured(rate, at) if dark.doubling_k is None else Doubling(rate, at, dark.doubling_k)


def dark_components(camera: Camera) -> tuple[DarkComponent, ...]:
    """The superimposed dark signals, in electrons."""
    unit = {"e": 1.0, "e_per_s": 1.0, "dn": 1 / gain_dn_per_e(camera)}
    return tuple(
        DarkComponent(
            part.weight,
            part.family,
            *((part.low, part.high) if part.family == "uniform" else (part.mean, part.sigma)),  # type: ignore[arg-type]
            e_per_unit=unit[part.unit],
            per_second=part.unit == "e_per_s",
        )
        for part in camera.dark_current.components
    )


def _blinking(camera: Camera) -> RtsPixels:
    dark = camera.dark_current
    return RtsPixels(dark.rts_fraction, dark.rts_amplitude_e_per_s, dark.rts_switching, dark.rts_duty)


def _node(camera: Camera) -> SenseNode | NonlinearSenseNode:
    gain, readout = sense_gain_v_per_e(camera), camera.readout
    if readout.ve_nonlinearity > 1e-100:  # below, 1/α overflows and nothing bends
        return NonlinearSenseNode(gain, readout.v_ref_v, readout.ve_nonlinearity)
    return SenseNode(gain)


def _follower(camera: Camera) -> SourceFollower | NonlinearSourceFollower:
    follower = camera.source_follower
    if follower.vv_nonlinearity == 1:
        return SourceFollower(follower.gain)
    full_swing_v = camera.pixel.full_well_e * sense_gain_v_per_e(camera)
    return NonlinearSourceFollower(follower.gain, follower.vv_nonlinearity, full_swing_v)


def _integral(camera: Camera) -> tuple[IntegralNonlinearity, ...]:
    adc = camera.adc
    gamma = gamma_of_ile(adc.ile) if adc.ile is not None else adc.gamma
    return () if gamma in (None, 1.0) else (IntegralNonlinearity(gamma, full_scale_v(camera)),)


def sense_gain_v_per_e(camera: Camera) -> float:
    """A_SN [V/e-]: as given, or V_REF·q/k₁."""
    readout = camera.readout
    if readout.sense_gain_uv_per_e is not None:
        return readout.sense_gain_uv_per_e * 1e-6
    return readout.v_ref_v * ELEMENTARY_CHARGE_C / readout.ve_k1_c  # type: ignore[operator]


def follower_sigma_v(camera: Camera) -> float:
    """Noise of the source follower at the sense node [V rms]. A CCD has one amplifier and no telegraph noise."""
    follower = camera.source_follower
    if follower.read_noise_e is not None:
        return follower.read_noise_e * sense_gain_v_per_e(camera)
    noise = CdsNoise(
        white_nv_per_rthz=follower.white_nv_per_rthz or 0.0,
        corner_hz=follower.corner_hz,
        sample_s=follower.cds_sample_s,
        dominant_s=follower.cds_dominant_s,
        rtn_uv=0.0 if camera.sensor.technology == "ccd" else follower.rtn_uv,
        rtn_s=follower.rtn_s,
        band_hz=follower.band_hz,
    )
    return noise.sigma_v / follower.gain


def full_scale_v(camera: Camera) -> float:
    """V_FS, the swing that fills the code range [V]; the swing of a full well unless the datasheet says otherwise."""
    if camera.adc.full_scale_v is not None:
        return camera.adc.full_scale_v
    return camera.pixel.full_well_e * volts_per_electron(camera)


def volts_per_electron(camera: Camera) -> float:
    """A_SN·A_SF·A_CDS [V/e-]."""
    return sense_gain_v_per_e(camera) * camera.source_follower.gain * camera.readout.cds_gain


def adc_gain_dn_per_v(camera: Camera) -> float:
    """A = 2^bits/V_FS [DN/V]."""
    return 2.0**camera.adc.bits / full_scale_v(camera)


def gain_dn_per_e(camera: Camera) -> float:
    """EMVA 1288's overall system gain K = A_SN·A_SF·A_CDS·2^bits/V_FS [DN/e-]."""
    return volts_per_electron(camera) * adc_gain_dn_per_v(camera)


def black_level_dn(camera: Camera) -> float:
    """What darkness reads: as given, else 4σ of a zero exposure, rounded up, but never above 1/8 of the range [DN]."""
    if camera.adc.black_level_dn is not None:
        return camera.adc.black_level_dn
    m = Moments(0.0, 0.0, 0.0, Frame(BLACK_LEVEL_AT, SensorWindow(0, (1, 1))))
    for stage in analogue(camera):
        m = stage.moments(m)
    sigma = math.hypot(m.sigma * adc_gain_dn_per_v(camera), math.sqrt(1 / 12))
    return float(min(math.ceil(4 * sigma), (2**camera.adc.bits - 1) // 8))
