"""The chain of the released MATLAB code of Konnik & Welsh 2014, for comparison with published results.

    settings = Konnik2014Settings.from_camera(load_camera("konnik_table1"), reset_factor=0.8)
    signal = photons
    for stage in chain_of(settings):
        signal = stage.sample(signal, frame)

Where the paper's formula and the released code differ, this is the code; where both differ from physics, see
``docs/konnik2014.md``. The three formulas of the paper that give no image are refused with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Self

from ...core.errors import InputError, nearest, require
from ..camera import Camera
from ..effects.reset_noise import RESET_RESIDUAL
from ..gains import sense_gain_v_per_e
from ..stage import Chain, Stage
from .electrons import (
    PublishedDarkFpn,
    PublishedDarkMean,
    PublishedDarkShot,
    PublishedDarkSignal,
    PublishedFollowerSpectrum,
    PublishedPhotons,
    PublishedPhotonShot,
    PublishedPrnu,
    PublishedQuantumEfficiency,
    PublishedReadNoise,
    PublishedWell,
)
from .fpn_distributions import FPN_DISTRIBUTIONS, FpnDistribution, PublishedNormal
from .volts import (
    PublishedAdc,
    PublishedColumnFpn,
    PublishedExponentialNode,
    PublishedFollower,
    PublishedResetNoise,
    PublishedSenseNode,
)

PAPER_ONLY = {
    ("dark_fpn", "paper_eq18"): (
        "the paper's 1 + lnN(0, (t·D_R·D_N)²) takes electrons for a logarithm: its mean is 941 e- where 174 is meant "
        "at 0.1 s, and it overflows at 10 s; use 'lognormal', which the released code scales by D_N"
    ),
    ("reset", "paper_eq27"): (
        "the paper adds lnN(0, σ²) to V_REF, and a log-normal has median 1: the reference rises by a volt and every "
        "pixel reads 0; use 'lognormal_minus_one', as the released code does"
    ),
    ("adc_reference", "paper_eq35"): (
        "the paper subtracts the node voltage, about 3 V, from V_ADC.REF, the largest voltage that the converter can "
        "quantify, 0.165 V here: every pixel reads 0; use 'reset_level', which subtracts it from V_REF, as the "
        "released code does"
    ),
}
"""(setting, value) → why that formula of the paper is refused, and what to use instead."""

CHOICES = {
    "technology": ("cmos", "ccd"),
    "dark_fpn": tuple(FPN_DISTRIBUTIONS),
    "column_fpn": tuple(FPN_DISTRIBUTIONS),
    "reset": ("lognormal_minus_one",),
    "adc_reference": ("reset_level",),
}

RANGES = {
    "quantum_efficiency": (0.0, 1.0, "electrons per photon, e.g. 0.6"),
    "prnu": (0.0, 1.0, "a fraction, e.g. 0.005"),
    "pixel_area_cm2": (1e-12, 1.0, "e.g. 3.249e-7 for 5.7 µm squared"),
    "dark_fom_na_per_cm2": (0.0, 1e9, "e.g. 1.0"),
    "dark_fpn_factor": (0.0, 1e3, "D_N, e.g. 0.01"),
    "source_follower_e": (0.0, 1e6, "electrons rms, e.g. 6.09"),
    "full_well_e": (1.0, 1e9, "electrons, e.g. 33000"),
    "sense_gain_uv_per_e": (1e-3, 1e3, "microvolts per electron, e.g. 5"),
    "reference_v": (1e-3, 1e3, "volts, e.g. 3.1"),
    "reset_factor": (0.0, 1.0, "1 for all of the kTC noise, 0 for none"),
    "ve_alpha": (0.0, 1.0, "0 is linear, e.g. 0.05"),
    "vv_gamma": (0.5, 2.0, "1 is linear, e.g. 1.05"),
    "column_fpn_factor": (0.0, 1.0, "a fraction of the full-well swing, e.g. 0.001"),
    "adc_bits": (1, 24, "bits, e.g. 12"),
    "adc_gamma": (0.5, 2.0, "1 is linear, e.g. 1.04"),
}

PARAMETER_RANGES = {
    "gaussian": (-math.inf, math.inf, "not used"),
    "lognormal": (0.0, 5.0, "sigma of the logarithm, e.g. 0.4"),
    "wald": (0.1, 100.0, "chi, e.g. 2"),
    "ar": (-0.5, 0.5, "recursive coefficient, e.g. 0.5"),
}


@dataclass(frozen=True)
class Konnik2014Settings:
    """Settings of the published chain. Defaults: the *simple* parameters of the released code, for Table 1's sensor.

    Neutral values leave a stage out: 0 for noise and FPN, 1 for the gammas, False for the shot noises.
    dark_fpn, column_fpn : "gaussian" | "lognormal" | "wald" | "ar" with their number in ``…_parameter``.
    Raises InputError for a value out of its range, and for the formulas of the paper in ``PAPER_ONLY``.
    """

    technology: str = "cmos"  # a CCD has no reset noise and no column FPN
    quantum_efficiency: float = 0.6  # Table 1
    photon_shot: bool = True
    prnu: float = 0.005  # Table 1
    pixel_area_cm2: float = 3.249e-7  # Table 1: 5.7 µm squared; the fill factor is in the photons
    dark_fom_na_per_cm2: float = 1.0  # Table 1
    dark_shot: bool = True
    dark_fpn: str = "gaussian"  # released parameters, simple
    dark_fpn_factor: float = 0.01  # Table 1, D_N
    dark_fpn_parameter: float = 0.0
    source_follower_e: float = 0.0  # released parameters, simple; advanced: PublishedFollowerSpectrum().sigma_e(5.0)
    full_well_e: float = 33000.0  # Table 1
    sense_gain_uv_per_e: float = 5.0  # Table 1
    reference_v: float = 3.1  # released parameters
    reset: str = "lognormal_minus_one"
    reset_factor: float = 0.8  # released parameters
    ve_alpha: float = 0.0
    vv_gamma: float = 1.0
    column_fpn: str = "gaussian"
    column_fpn_factor: float = 0.001  # Table 1
    column_fpn_parameter: float = 0.0
    adc_bits: int = 12  # Table 1
    adc_gamma: float = 1.0
    adc_reference: str = "reset_level"

    def __post_init__(self) -> None:
        for (name, value), reason in PAPER_ONLY.items():
            if getattr(self, name) == value:
                raise InputError(f"{name} = {value!r} cannot run: {reason}.")
        for name, known in CHOICES.items():
            if (chosen := getattr(self, name)) not in known:
                raise InputError(f"{name} is {chosen!r}; it must be one of {', '.join(known)}.")
        for name, (low, high, remedy) in RANGES.items():
            require(name, getattr(self, name), low, high, remedy)
        if self.adc_bits != int(self.adc_bits):
            raise InputError(f"adc_bits is {self.adc_bits!r}; it must be a whole number (e.g. 12).")
        for which in ("dark_fpn", "column_fpn"):
            require(f"{which}_parameter", getattr(self, f"{which}_parameter"), *PARAMETER_RANGES[getattr(self, which)])

    @classmethod
    def from_camera(cls, camera: Camera, **overrides: Any) -> Self:
        """Settings from a camera of the physical chain; ``overrides`` are settings by name and take precedence.

        Black level, full scale and CDS gain of the camera are not used: the published chain has none. Raises InputError
        for what it cannot express (colour filters, a measured dark rate, a gain A_SF) and ``overrides`` does not set.
        """
        known = {field.name for field in fields(cls)}
        for name in overrides:
            if name not in known:
                raise InputError(f"{name} is no setting of the published chain.{nearest(name, known)}")
        taken: dict[str, float | str] = {
            "technology": camera.sensor.technology,
            "prnu": camera.pixel.prnu,
            "pixel_area_cm2": camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-8,
            "full_well_e": camera.pixel.full_well_e,
            "sense_gain_uv_per_e": sense_gain_v_per_e(camera) * 1e6,
            "reset_factor": RESET_RESIDUAL[camera.readout.reset],
            "column_fpn_factor": camera.readout.dsnu_col,
            "adc_bits": camera.adc.bits,
        }
        for names, take in _TAKEN.items():
            if not set(names) <= set(overrides):
                taken |= dict(zip(names, take(camera), strict=True))
        return cls(**(taken | overrides))

    @property
    def full_well_v(self) -> float:
        """V_FW, the swing of a full well [V]; 0.165 for Table 1."""
        return self.full_well_e * self.sense_gain_uv_per_e * 1e-6

    @property
    def adc_gain_dn_per_v(self) -> float:
        """A = 2^bits/(V_FW − V_min); V_min = q·A_SN/C_SN = A_SN² in numbers, 2.5e-11 for 5 µV/e-."""
        return 2.0**self.adc_bits / (self.full_well_v - (self.sense_gain_uv_per_e * 1e-6) ** 2)


def chain_of(settings: Konnik2014Settings) -> Chain:
    """The published stages in their order, from photons to digital numbers."""
    s = settings
    stages: list[Stage] = [PublishedPhotons()]
    if s.photon_shot:
        stages.append(PublishedPhotonShot())
    stages.append(PublishedQuantumEfficiency(s.quantum_efficiency))
    if s.prnu:
        stages.append(PublishedPrnu(s.prnu, PublishedNormal()))
    if dark := _dark(s):
        stages.append(PublishedDarkSignal(dark))
    return (*stages, PublishedWell(s.full_well_e), *_volts(s))


def _dark(s: Konnik2014Settings) -> Chain:
    steps: list[Stage] = []
    if s.dark_fom_na_per_cm2:
        steps.append(PublishedDarkMean(s.dark_fom_na_per_cm2, s.pixel_area_cm2))
        if s.dark_shot:
            steps.append(PublishedDarkShot())
        if s.dark_fpn_factor:
            steps.append(PublishedDarkFpn(s.dark_fpn_factor, _distribution(s.dark_fpn, s.dark_fpn_parameter)))
    if s.source_follower_e:
        steps.append(PublishedReadNoise(s.source_follower_e))
    return tuple(steps)


def _volts(s: Konnik2014Settings) -> Chain:
    gain, cmos = s.sense_gain_uv_per_e * 1e-6, s.technology == "cmos"
    reset = PublishedResetNoise(gain, s.reset_factor if cmos else 0.0)
    stages: list[Stage] = [PublishedSenseNode(s.reference_v, gain, reset)]
    if s.ve_alpha:
        stages = [PublishedExponentialNode(s.reference_v, s.ve_alpha, reset)]
    if s.vv_gamma != 1:
        stages.append(PublishedFollower(s.reference_v, s.full_well_v, s.vv_gamma))
    if s.column_fpn_factor and cmos:
        distribution = _distribution(s.column_fpn, s.column_fpn_parameter)
        stages.append(PublishedColumnFpn(s.column_fpn_factor * s.full_well_v, distribution))
    adc = PublishedAdc(s.adc_bits, s.adc_gain_dn_per_v, s.reference_v, s.full_well_v, s.adc_gamma)
    return (*stages, adc)


def _distribution(name: str, parameter: float) -> FpnDistribution:
    return PublishedNormal() if name == "gaussian" else FPN_DISTRIBUTIONS[name](parameter)


def _quantum_efficiency(camera: Camera) -> tuple[float]:
    reference = camera.quantum_efficiency.reference_nm
    if reference is None or len(camera.filter_names) > 1:
        raise InputError(
            f"{camera.name} has {len(camera.filter_names)} colour filter(s) and quantum_efficiency.reference_nm "
            f"{reference}; the published chain has one QE: pass e.g. quantum_efficiency=0.6."
        )
    return (float(camera.qe([reference])[0, 0]),)


def _dark_fom(camera: Camera) -> tuple[float]:
    if camera.dark_current.fom_na_per_cm2 is None:
        raise InputError(
            f"{camera.name} gives its dark current as a rate; the published chain has only the figure of merit: "
            f"pass e.g. dark_fom_na_per_cm2=1.0."
        )
    return (camera.dark_current.fom_na_per_cm2,)


def _dark_fpn(camera: Camera) -> tuple[str, float, float]:
    """The log-normal of the released code is LogNormal(0, 0.4) times D_N for every D_N."""
    numbers = {"gaussian": 0.0, "lognormal": 0.4}
    name = camera.dark_current.distribution
    if name not in numbers:
        raise InputError(
            f"{camera.name} has dark_current.distribution {name!r}, which the published chain lacks; "
            f"pass e.g. dark_fpn='lognormal', dark_fpn_factor=0.01, dark_fpn_parameter=0.4."
        )
    return name, camera.dark_current.cv, numbers[name]


def _source_follower(camera: Camera) -> tuple[float]:
    follower = camera.source_follower
    if follower.gain != 1:
        raise InputError(
            f"{camera.name} has source_follower.gain {follower.gain}; the published chain would multiply the whole "
            f"node voltage by it (0.9 saturates every pixel), and only 1 is on record: pass source_follower_e=6.09."
        )
    if follower.read_noise_e is not None:
        return (follower.read_noise_e,)
    published = PublishedFollowerSpectrum(
        white_nv_per_rthz=follower.white_nv_per_rthz or 0.0,
        corner_hz=follower.corner_hz,
        sample_s=follower.cds_sample_s,
        dominant_s=follower.cds_dominant_s,
        rtn_step=0.0 if camera.sensor.technology == "ccd" else follower.rtn_uv * 1e-6,
        rtn_s=follower.rtn_s,
    )
    return (published.sigma_e(sense_gain_v_per_e(camera) * 1e6),)


def _column_fpn(camera: Camera) -> tuple[str, float]:
    if camera.readout.dsnu_col_coupling:
        raise InputError(
            f"{camera.name} has readout.dsnu_col_coupling {camera.readout.dsnu_col_coupling}, an isotropic process "
            f"that the published chain lacks; pass e.g. column_fpn='ar', column_fpn_parameter=0.5."
        )
    return "gaussian", 0.0


_TAKEN: dict[tuple[str, ...], Callable[[Camera], tuple[float | str, ...]]] = {
    ("quantum_efficiency",): _quantum_efficiency,
    ("dark_fom_na_per_cm2",): _dark_fom,
    ("dark_fpn", "dark_fpn_factor", "dark_fpn_parameter"): _dark_fpn,
    ("source_follower_e",): _source_follower,
    ("column_fpn", "column_fpn_parameter"): _column_fpn,
}
"""Settings → function that reads them from a camera, called unless all of them are given."""
