"""The stages that volts leave. A signal is a *swing* S ≥ 0, the drop below the reference; V_REF − S is never formed.

(Near 3 V a float32 step is 0.05 e-: carrying the node voltage itself would cost up to 39 % of the pixels at 16 bit.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..core import arrays
from ..core.backend import normals
from ..core.frame import Frame
from ..core.moments import Moments
from ..core.sensor_window import SensorWindow
from ..core.signals import Electrons
from ..core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C


@dataclass(frozen=True)
class SenseNode:
    """Charge becomes a voltage: S = A_SN·N (paper eq. 29, linear).

    gain_v_per_e : A_SN [V/e-], 1–10 µV/e- typical.
    """

    gain_v_per_e: float
    domain: ClassVar[str] = "volts"

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain."""
        return self.gain_v_per_e

    def __call__(self, electrons: Electrons, frame: Frame) -> Any:
        """Electrons → swing (H, W) [V]."""
        return frame.number(self.gain_v_per_e) * electrons.total

    def moments(self, m: Moments) -> Moments:
        """Scaled by A_SN."""
        return m.scale(self.gain_v_per_e)


@dataclass(frozen=True)
class NonlinearSenseNode:
    """The node's capacitance grows as its voltage drops: S = −(V_REF/α)·expm1(−α·A_SN·N/V_REF) (paper eq. 8, 33).

    gain_v_per_e : small-signal A_SN [V/e-].  v_ref_v : V_REF [V].  alpha : strength, above 0 to 1.
    """

    gain_v_per_e: float
    v_ref_v: float
    alpha: float
    domain: ClassVar[str] = "volts"

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain."""
        return self.gain_v_per_e

    def __call__(self, electrons: Electrons, frame: Frame) -> Any:
        """Electrons → swing (H, W) [V], below V_REF/α."""
        return frame.number(-self.v_ref_v / self.alpha) * arrays.expm1(frame.number(-self._rate) * electrons.total)

    def moments(self, m: Moments) -> Moments:
        """Second order in the noise; slope A_SN·e^(−αA_SN·N/V_REF)."""
        fall = arrays.exp(-self._rate * m.mean)
        value = -(self.v_ref_v / self.alpha) * arrays.expm1(-self._rate * m.mean)
        return m.through(value, self.gain_v_per_e * fall, -self.gain_v_per_e * self._rate * fall)

    @property
    def _rate(self) -> float:
        return self.alpha * self.gain_v_per_e / self.v_ref_v


@dataclass(frozen=True)
class ResetNoise:
    """The reset leaves a random charge on the node: + residual·√(k_B·T/C_SN)·z, C_SN = q/A_SN (paper eq. 7, 27).

    gain_v_per_e : A_SN [V/e-].  residual : what the reset and the CDS leave of it; hard reset 1, soft reset 1/√2.
    """

    gain_v_per_e: float
    residual: float
    domain: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing with signed, zero-mean noise."""
        sigma = self.sigma_v(frame)
        return swing + frame.number(sigma) * frame.normal("reset") if sigma else swing

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
    domain: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing with noise."""
        return swing + frame.number(self.sigma_v) * frame.normal("source_follower") if self.sigma_v else swing

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the temporal variance."""
        return m.add(temporal=self.sigma_v**2)


@dataclass(frozen=True)
class Gain:
    """An amplifier: S·gain. It acts on the swing, so darkness stays dark for every gain.

    gain : [V/V].
    """

    gain: float
    domain: ClassVar[str] = "volts"

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain."""
        return self.gain

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Scaled swing."""
        return swing if self.gain == 1 else frame.number(self.gain) * swing

    def moments(self, m: Moments) -> Moments:
        """Scaled by the gain."""
        return m.scale(self.gain)


@dataclass(frozen=True)
class SourceFollower(Gain):
    """The amplifier in the pixel, A_SF, 0.7–1 typical (paper eq. 31)."""


@dataclass(frozen=True)
class NonlinearSourceFollower:
    """The amplifier's gain changes with the swing: A_SF·S·[1 + (γ−1)·S/S_FW] (paper eq. 9, 34, on the swing).

    gain : A_SF for small signals.  ratio : γ, gain at full well over gain at zero, above ½.  full_swing_v : S_FW [V].
    """

    gain: float
    ratio: float
    full_swing_v: float
    domain: ClassVar[str] = "volts"

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain."""
        return self.gain

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Bent swing."""
        return (frame.number(self.gain) * swing) * (1 + frame.number(self._bend) * swing)

    def moments(self, m: Moments) -> Moments:
        """A parabola: exact for a normal signal. At full well γ = 1.05 multiplies the variance by 1.21."""
        value = self.gain * m.mean * (1 + self._bend * m.mean)
        return m.through(value, self.gain * (1 + 2 * self._bend * m.mean), 2 * self.gain * self._bend)

    @property
    def _bend(self) -> float:
        return (self.ratio - 1) / self.full_swing_v


@dataclass(frozen=True)
class PrnuColumn:
    """Every column amplifier has its own gain, and keeps it: S·(1 + cv·x_j), x_j isotropic AR of variance 1.

    cv : σ of the gain over its mean.  coupling : a of the AR, 0 … 0.4999.
    """

    cv: float
    coupling: float = 0.0
    domain: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing times the camera's column gains."""
        if self.cv == 0 and "prnu_col" not in frame.window.given:
            return swing
        return swing * self.maps(frame.window)["prnu_col"]

    def moments(self, m: Moments) -> Moments:
        """Product of independent factors: the gain's spread acts on the signal's own as well."""
        mean, variance = m.frame.window.map_moments("prnu_col", 1.0, self.cv**2)
        if variance == 0:
            return m.scale(mean)
        squared = mean**2 + variance
        fixed = m.spatial * squared + arrays.product(m.mean**2, variance)
        return replace(m, mean=m.mean * mean, temporal=m.temporal * squared, spatial=fixed)

    def maps(self, window: SensorWindow) -> dict[str, Any]:
        """``column_gain``: gain of every column, 1 on average, (1, W)."""
        make = lambda: 1 + window.number(self.cv) * window.line_map("prnu_col", self.coupling)  # noqa: E731
        return {"prnu_col": window.given_or("prnu_col", make)}


@dataclass(frozen=True)
class Offset:
    """A fixed offset that the signal does not change: + residual·gain·o, o an isotropic AR pattern (paper eq. 28, 32).

    sigma_e : σ of the offsets, as electrons at the sense node.  gain_v_per_e : what an electron is here [V/e-].
    coupling : a of the AR.  residual : what the CDS leaves of the offsets, 0 … 1.
    """

    sigma_e: float
    gain_v_per_e: float
    coupling: float = 0.0
    residual: float = 1.0
    domain: ClassVar[str] = "volts"
    source: ClassVar[str]

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing with the camera's offsets."""
        if self.sigma_e == 0 and self._name not in frame.window.given:
            return swing
        return swing + frame.number(self.residual * self.gain_v_per_e) * self.maps(frame.window)[self._name]

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the fixed variance."""
        mean, variance = m.frame.window.map_moments(self._name, 0.0, self.sigma_e**2)
        gain = self.residual * self.gain_v_per_e
        return m.add(mean=gain * mean, spatial=gain**2 * variance)

    def maps(self, window: SensorWindow) -> dict[str, Any]:
        """The offsets in electrons, 0 on average."""
        return {self._name: window.given_or(self._name, lambda: window.number(self.sigma_e) * self._unit(window))}

    @property
    def _name(self) -> str:
        return f"{self.source}_e"

    def _unit(self, window: SensorWindow) -> Any:
        raise TypeError("an offset belongs to columns, rows or pixels")


@dataclass(frozen=True)
class DsnuColumn(Offset):
    """Every column has its own offset, and keeps it: vertical stripes."""

    source: ClassVar[str] = "dsnu_col"

    def _unit(self, window: SensorWindow) -> Any:
        return window.line_map(self.source, self.coupling, axis=1)


@dataclass(frozen=True)
class DsnuRow(Offset):
    """Every row has its own offset, and keeps it: horizontal stripes."""

    source: ClassVar[str] = "dsnu_row"

    def _unit(self, window: SensorWindow) -> Any:
        return window.line_map(self.source, self.coupling, axis=0)


@dataclass(frozen=True)
class DsnuPixel(Offset):
    """Every pixel has its own offset, and keeps it (the pixel component of El Gamal et al. 1998)."""

    source: ClassVar[str] = "dsnu_pixel"

    def _unit(self, window: SensorWindow) -> Any:
        if self.coupling:
            return window.correlated(self.source, self.coupling)
        return window.fixed_map(self.source, normals)


@dataclass(frozen=True)
class CdsGain(Gain):
    """The amplifier of the correlated double sampling, A_CDS, 1 typical."""
