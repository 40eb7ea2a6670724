"""The stages that volts leave. A signal is a *swing* S ≥ 0, the drop below the reference; V_REF − S is never formed.

(Near 3 V a float32 step is 0.05 e-: carrying the node voltage itself would cost up to 39 % of the pixels at 16 bit.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..engine import arrays
from ..engine.frame import Frame
from ..engine.moments import Moments
from ..engine.quantities import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C, Electrons


@dataclass(frozen=True)
class SenseNode:
    """Charge becomes a voltage: S = A_SN·N (paper eq. 29, linear).

    gain_v_per_e : A_SN [V/e-], 1–10 µV/e- typical.
    """

    gain_v_per_e: float
    room: ClassVar[str] = "volts"

    def __call__(self, electrons: Electrons, frame: Frame) -> Any:
        """Electrons → swing (H, W) [V]."""
        return self.gain_v_per_e * electrons.total

    def moments(self, m: Moments) -> Moments:
        """Scaled by A_SN."""
        return m.scale(self.gain_v_per_e)


@dataclass(frozen=True)
class ResetNoise:
    """The reset leaves a random charge on the node: + residual·√(k_B·T/C_SN)·z, C_SN = q/A_SN (paper eq. 7, 27).

    gain_v_per_e : A_SN [V/e-].  residual : what the reset and the CDS leave of it; hard reset 1, soft reset 1/√2.
    """

    gain_v_per_e: float
    residual: float
    room: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing with signed, zero-mean noise."""
        sigma = self.sigma_v(frame)
        return swing + sigma * frame.normal("reset") if sigma else swing

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the temporal variance."""
        return m.add(temporal=self.sigma_v(m.frame) ** 2)

    def sigma_v(self, frame: Frame) -> float:
        """Noise at this exposure's temperature [V rms]."""
        squared = BOLTZMANN_J_PER_K * frame.exposure.temperature_k * self.gain_v_per_e / ELEMENTARY_CHARGE_C
        return self.residual * arrays.scalar_sqrt(squared)


@dataclass(frozen=True)
class SourceFollowerNoise:
    """The amplifier in the pixel is noisy: + σ_V·z, signed and not rounded (paper eq. 19–24, closed forms of cds.py).

    sigma_v : at the sense node, after CDS [V rms].
    """

    sigma_v: float
    room: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing with noise."""
        return swing + self.sigma_v * frame.normal("source_follower") if self.sigma_v else swing

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the temporal variance."""
        return m.add(temporal=self.sigma_v**2)


@dataclass(frozen=True)
class SourceFollower:
    """The amplifier's gain on the swing: S·A_SF (paper eq. 31); darkness stays dark for every gain.

    gain : A_SF, 0.7–1 typical.
    """

    gain: float
    room: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Scaled swing."""
        return swing if self.gain == 1 else self.gain * swing

    def moments(self, m: Moments) -> Moments:
        """Scaled by A_SF."""
        return m.scale(self.gain)


@dataclass(frozen=True)
class ColumnOffset:
    """Every column has its own offset, and keeps it: + σ·x_j, x_j isotropic AR of variance 1 (paper eq. 28, 32).

    sigma_v : D_col·V_FW [V].  coupling : a of the AR, 0 … 0.4999; neighbouring columns correlate by 2a.
    """

    sigma_v: float
    coupling: float = 0.0
    room: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing with the camera's column stripes."""
        if self.sigma_v == 0:
            return swing
        return swing + self.sigma_v * frame.device.line_pattern("column_offset", self.coupling)

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the fixed variance."""
        return m.add(fixed=self.sigma_v**2)


@dataclass(frozen=True)
class CdsGain:
    """Gain of the correlated double sampling amplifier: S·A_CDS.

    gain : A_CDS, 1 typical.
    """

    gain: float
    room: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Scaled swing."""
        return swing if self.gain == 1 else self.gain * swing

    def moments(self, m: Moments) -> Moments:
        """Scaled by A_CDS."""
        return m.scale(self.gain)
