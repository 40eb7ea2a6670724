"""Voltage and ADC stages of the released MATLAB code of Konnik & Welsh 2014, on NumPy float64.

As in ``electrons.py`` the behaviour is reproduced, not the text. The volts here are *node voltages* V_REF − S, as
published, not the swing S of the physical chain; some of the published effects exist only because of that.
"""

import math
from dataclasses import dataclass

import numpy as np

from mitsuba_sensor.core import Array, Frame
from mitsuba_sensor.stages.stage import Converter, Stage

from .electrons import PublishedFpn

ELEMENTARY_CHARGE_C, BOLTZMANN_J_PER_K = (
    1.602176487e-19,
    1.3806504e-23,
)  # CODATA 2006, as in that code
K1_C = 10.909e-15  # k₁ [C] (paper eq. 8); with V_REF = 3.1 V it implies 45.5 µV/e-, independent of A_SN


@dataclass(frozen=True)
class PublishedResetNoise:
    """factor·(exp(σz) − 1) [V], σ = √(k_B·T·A_SN/q) (paper eq. 7, and 27 without the +1 V that its log-normal adds)."""

    gain_v_per_e: float  # A_SN
    factor: float  # 0 for a CCD, 0.8 in the released parameters

    def __call__(self, frame: Frame) -> Array:
        """Noise that is added to V_REF, (H, W) [V]."""
        if self.factor:
            return self.factor * np.expm1(self.sigma(frame) * frame.normal("reset"))
        return 0.0

    def sigma(self, frame: Frame) -> float:
        """σ of the normal in the exponent; 3.584e-4 for 5 µV/e- at 298.15 K."""
        return math.sqrt(
            BOLTZMANN_J_PER_K
            * frame.exposure.temperature_k
            * self.gain_v_per_e
            / ELEMENTARY_CHARGE_C
        )

    def moments(self, frame: Frame) -> tuple[float, float]:
        """Mean [V] and variance [V²]."""
        squared = self.sigma(frame) ** 2
        return self.factor * math.expm1(squared / 2), self.factor**2 * math.exp(
            squared
        ) * math.expm1(squared)


@dataclass(frozen=True)
class PublishedSenseNode(Stage):
    """V = V_REF + reset − A_SN·N (paper eq. 29, 30).  reference_v : V_REF [V].  gain_v_per_e : A_SN [V/e-]."""

    reference_v: float
    gain_v_per_e: float
    reset: PublishedResetNoise
    domain = "volts"

    def sample(self, electrons: Array, frame: Frame) -> Array:
        """Electrons → node voltage (H, W) [V]."""
        return self.reference_v + self.reset(frame) - self.gain_v_per_e * electrons


@dataclass(frozen=True)
class PublishedExponentialNode(Stage):
    """V = (V_REF + reset)·exp(−α·q·N/k₁) (paper eq. 33): A_SN does not enter, α = 0.05 reads 0.45 of the signal."""

    reference_v: float  # V_REF
    alpha: float  # coefficient of non-linearity, above 0
    reset: PublishedResetNoise
    domain = "volts"

    def sample(self, electrons: Array, frame: Frame) -> Array:
        """Electrons → node voltage (H, W) [V]."""
        return (self.reference_v + self.reset(frame)) * np.exp(-self.per_e * electrons)

    @property
    def per_e(self) -> float:
        """α·q/k₁, the relative drop per electron."""
        return self.alpha * ELEMENTARY_CHARGE_C / K1_C


@dataclass(frozen=True)
class PublishedFollower(Stage):
    """V·(1 + (γ − 1)·(V_REF − V)/(V_FW·V_REF)), the *node voltage* times a gain of the swing (paper eq. 9, 34)."""

    reference_v: float
    full_well_v: float  # V_FW
    gamma: float  # above 0; 1.05 takes 29 % to 30 % of the signal away
    domain = "volts"

    def sample(self, volts: Array, frame: Frame) -> Array:
        """Node voltage → voltage after the source follower (H, W) [V]."""
        return volts * (1 + self.bend * (self.reference_v - volts))

    @property
    def bend(self) -> float:
        """Change of the gain per volt of swing [1/V]."""
        return (self.gamma - 1) / (self.full_well_v * self.reference_v)


class PublishedColumnFpn(PublishedFpn):
    """V·(1 + D·V_FW·x_j), x_j per column (paper eq. 28, 32 *add*): 512 µV where D·V_FW = 165 µV is meant."""

    domain, source = "volts", "dsnu_col"  # factor : D·V_FW, used as a number without unit


@dataclass(frozen=True)
class PublishedAdc(Converter):
    """round(A·S·γ^(−S/V_FW)), S = V_REF − V, clipped to 0 … 2^bits: a code too many, no black level (paper 35–37)."""

    bits: int
    gain_dn_per_v: float  # A = 2^bits/(V_FW − A_SN²)
    reference_v: float
    full_well_v: float  # V_FW
    gamma: float = 1.0  # linear

    def sample(self, volts: Array, frame: Frame) -> Array:
        """Voltage [V] → whole digital numbers (H, W)."""
        return np.clip(np.floor(self._code(self.reference_v - volts) + 0.5), 0.0, self.highest)

    def _code(self, swing: Array) -> Array:
        return self.gain_dn_per_v * swing * self.gamma ** (-swing / self.full_well_v)

    @property
    def highest(self) -> int:
        """The largest code, 2^bits."""
        return 1 << self.bits
