"""The chain of the released MATLAB code of Konnik & Welsh 2014, for comparison with published results.

    settings = Konnik2014Settings(vv_gamma=1.05, adc_gamma=1.04)
    signal = photons
    for stage in chain_of(settings):
        signal = stage.sample(signal, frame)

Where the paper's formula and the released code differ, this is the code; where both differ from physics, see
``docs/stages.md``. The three formulas of the paper that give no image are refused with the reason.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from mitsuba_sensor.core import InputError, require
from mitsuba_sensor.core.options import Option, declared
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

    technology: Annotated[
        Literal["cmos", "ccd"], Option("A CCD has no reset noise and no column FPN.")
    ] = "cmos"
    quantum_efficiency: Annotated[
        float, Option("Electrons per photon.", low=0, high=1, example="0.6")
    ] = 0.6  # Table 1
    photon_shot: Annotated[bool, Option("Photon shot noise.")] = True
    prnu: Annotated[float, Option("PRNU, a fraction.", low=0, high=1, example="0.005")] = (
        0.005  # Table 1
    )
    pixel_area_cm2: Annotated[
        float, Option("Table 1.", low=1e-12, high=1, example="3.249e-7")
    ] = 3.249e-7
    dark_fom_na_per_cm2: Annotated[float, Option("D_FM.", low=0, high=1e9, example="1.0")] = (
        1.0  # Table 1
    )
    dark_shot: Annotated[bool, Option("Dark shot noise.")] = True
    dark_fpn: Annotated[FpnName, Option("Distribution of the dark FPN.")] = (
        "gaussian"  # released parameters, simple
    )
    dark_fpn_factor: Annotated[float, Option("D_N.", low=0, high=1e3, example="0.01")] = (
        0.01  # Table 1
    )
    dark_fpn_parameter: Annotated[float, Option("Of that distribution.")] = 0.0
    source_follower_e: Annotated[
        float, Option("Read noise [e- rms].", low=0, high=1e6, example="6.09")
    ] = 0.0
    full_well_e: Annotated[float, Option("Full well.", low=1, high=1e9, example="33000")] = (
        33000.0  # Table 1
    )
    sense_gain_uv_per_e: Annotated[float, Option("A_SN.", low=1e-3, high=1e3, example="5")] = (
        5.0  # Table 1
    )
    reference_v: Annotated[float, Option("V_REF.", low=1e-3, high=1e3, example="3.1")] = (
        3.1  # released parameters
    )
    reset: Annotated[Literal["lognormal_minus_one"], Option("Reset noise.")] = (
        "lognormal_minus_one"
    )
    reset_factor: Annotated[
        float, Option("1: all kTC noise, 0: none.", low=0, high=1, example="0.8")
    ] = 0.8
    ve_alpha: Annotated[float, Option("0 is linear.", low=0, high=1, example="0.05")] = 0.0
    vv_gamma: Annotated[float, Option("1 is linear.", low=0.5, high=2, example="1.05")] = 1.0
    column_fpn: Annotated[FpnName, Option("Distribution of the column FPN.")] = "gaussian"
    column_fpn_factor: Annotated[
        float, Option("D, Table 1.", low=0, high=1, example="0.001")
    ] = 0.001
    column_fpn_parameter: Annotated[float, Option("Of that distribution.")] = 0.0
    adc_bits: Annotated[int, Option("Bits.", low=1, high=24, example="12")] = 12  # Table 1
    adc_gamma: Annotated[float, Option("1 is linear.", low=0.5, high=2, example="1.04")] = 1.0
    adc_reference: Annotated[
        Literal["reset_level"], Option("What the signal is subtracted from.")
    ] = "reset_level"

    def __post_init__(self) -> None:
        for (name, value), reason in PAPER_ONLY.items():
            if getattr(self, name) == value:
                raise InputError(f"{name} = {value!r} cannot run: {reason}.")
        for setting in declared(type(self)):
            setting.checked(getattr(self, setting.name))
        for which in ("dark_fpn", "column_fpn"):
            require(
                f"{which}_parameter",
                getattr(self, f"{which}_parameter"),
                *PARAMETER_RANGES[getattr(self, which)],
            )

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
