"""The chain of the released MATLAB code of Konnik & Welsh 2014, for comparison with published results.

    settings = Konnik2014Settings(vv_gamma=1.05, adc_gamma=1.04)
    signal = photons
    for stage in chain_of(settings):
        signal = stage.sample(signal, frame)

Where the paper's formula and the released code differ, this is the code; where both differ from physics, see
``docs/stages.md``. The three formulas of the paper that give no image are refused with the reason.
"""

from dataclasses import dataclass
from typing import Literal

from mitsuba_sensor.core import InputError
from mitsuba_sensor.stages.stage import Chain, Stage

from . import electrons, volts
from .electrons import FpnName, PublishedFpnDistribution

PAPER_ONLY = {  # (setting, value) → why that formula of the paper is refused, and what to use instead
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


@dataclass(frozen=True)
class Konnik2014Settings:
    """Settings of the published chain. Defaults: the *simple* parameters of the released code, for Table 1's sensor.

    Neutral values leave a stage out: 0 for noise and FPN, 1 for the gammas, False for the shot noises. A CCD has no
    reset noise and no column FPN. reset_factor : 1 leaves all kTC noise, 0 none.
    dark_fpn, column_fpn : "gaussian" | "lognormal" | "wald" | "ar" with their number in ``…_parameter``: σ of the
        logarithm, χ, recursive coefficient. Raises InputError for the formulas of the paper in ``PAPER_ONLY``.
    """

    technology: Literal["cmos", "ccd"] = "cmos"
    quantum_efficiency: float = 0.6  # Table 1
    photon_shot: bool = True
    prnu: float = 0.005  # Table 1
    pixel_area_cm2: float = 3.249e-7  # Table 1
    dark_fom_na_per_cm2: float = 1.0  # D_FM, Table 1
    dark_shot: bool = True
    dark_fpn: FpnName = "gaussian"  # released parameters, simple
    dark_fpn_factor: float = 0.01  # D_N, Table 1
    dark_fpn_parameter: float = 0.0
    source_follower_e: float = 0.0  # read noise [e- rms]
    full_well_e: float = 33000.0  # Table 1
    sense_gain_uv_per_e: float = 5.0  # A_SN, Table 1
    reference_v: float = 3.1  # V_REF, released parameters
    reset: Literal["lognormal_minus_one"] = "lognormal_minus_one"
    reset_factor: float = 0.8
    ve_alpha: float = 0.0  # 0 is linear
    vv_gamma: float = 1.0  # 1 is linear
    column_fpn: FpnName = "gaussian"
    column_fpn_factor: float = 0.001  # D, Table 1
    column_fpn_parameter: float = 0.0
    adc_bits: int = 12  # Table 1
    adc_gamma: float = 1.0  # 1 is linear
    adc_reference: Literal["reset_level"] = "reset_level"

    def __post_init__(self) -> None:
        for (name, value), reason in PAPER_ONLY.items():
            if getattr(self, name) == value:
                raise InputError(f"{name} = {value!r} cannot run: {reason}.")

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
    s, gain, cmos = settings, settings.sense_gain_uv_per_e * 1e-6, settings.technology == "cmos"
    dark_fpn = PublishedFpnDistribution(s.dark_fpn, s.dark_fpn_parameter)
    column_fpn = PublishedFpnDistribution(s.column_fpn, s.column_fpn_parameter)
    reset = volts.PublishedResetNoise(gain, s.reset_factor if cmos else 0.0)
    dark = _used(
        (
            s.dark_fom_na_per_cm2,
            electrons.PublishedDarkMean(s.dark_fom_na_per_cm2, s.pixel_area_cm2),
        ),
        (s.dark_fom_na_per_cm2 and s.dark_shot, electrons.PublishedDarkShot()),
        (
            s.dark_fom_na_per_cm2 and s.dark_fpn_factor,
            electrons.PublishedDarkFpn(s.dark_fpn_factor, dark_fpn),
        ),
        (s.source_follower_e, electrons.PublishedReadNoise(s.source_follower_e)),
    )
    return _used(
        (1, electrons.PublishedPhotons()),
        (s.photon_shot, electrons.PublishedPhotonShot()),
        (1, electrons.PublishedQuantumEfficiency(s.quantum_efficiency)),
        (s.prnu, electrons.PublishedPrnu(s.prnu, PublishedFpnDistribution("gaussian"))),
        (len(dark), electrons.PublishedDarkSignal(dark)),
        (1, electrons.PublishedWell(s.full_well_e)),
        (not s.ve_alpha, volts.PublishedSenseNode(s.reference_v, gain, reset)),
        (s.ve_alpha, volts.PublishedExponentialNode(s.reference_v, s.ve_alpha, reset)),
        (s.vv_gamma != 1, volts.PublishedFollower(s.reference_v, s.full_well_v, s.vv_gamma)),
        (
            cmos and s.column_fpn_factor,
            volts.PublishedColumnFpn(s.column_fpn_factor * s.full_well_v, column_fpn),
        ),
        (
            1,
            volts.PublishedAdc(
                s.adc_bits, s.adc_gain_dn_per_v, s.reference_v, s.full_well_v, s.adc_gamma
            ),
        ),
    )


def _used(*stages: tuple[float, Stage]) -> Chain:
    """The stages whose first number is not 0."""
    return tuple(stage for used, stage in stages if used)
