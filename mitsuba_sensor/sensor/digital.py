"""The stages of the converter: volts in, digital numbers out."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import Any, ClassVar

from ..core import arrays
from ..core.frame import Frame
from ..core.moments import Moments
from ..core.special import largest, root


@dataclass(frozen=True)
class IntegralNonlinearity:
    """The converter's curve sags: S·γ^(−S/V_FS), that is A^(1−αV) = A·γ^(−V/V_FS) exactly (paper eq. 36-38).

    gamma : ratio of the gains at zero and at full scale, below e, where the curve stops being monotone; 1.04 is an
        end-point ILE of 0.99 %.  full_scale_v : V_FS [V].
    """

    gamma: float
    full_scale_v: float
    domain: ClassVar[str] = "volts"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Bent swing; no logarithm of the gain, so A = 1 is a gain like any other."""
        return swing if self.gamma == 1 else swing * arrays.exp(frame.number(-self._rate) * swing)

    def moments(self, m: Moments) -> Moments:
        """Second order in the noise."""
        k, fall = self._rate, arrays.exp(-self._rate * m.mean)
        return m.through(m.mean * fall, (1 - k * m.mean) * fall, (k * m.mean - 2) * k * fall)

    @property
    def _rate(self) -> float:
        return arrays.scalar_log(self.gamma) / self.full_scale_v


def gamma_of_ile(ile: float) -> float:
    """γ whose largest distance from the straight line through both ends is ``ile`` of full scale; 0.04 → 1.16633.

    The distance is max over x of x·γ^(1−x) − x.
    """
    return root(lambda gamma: end_point_ile(gamma) - ile, 1.0, 2.7) if ile else 1.0


def end_point_ile(gamma: float) -> float:
    """End-point integral linearity error of γ, a fraction of full scale; 1.04 → 0.0099."""
    k = arrays.scalar_log(gamma)
    return largest(lambda x: x * arrays.scalar_exp(k * (1 - x)) - x, 0.0, 1.0)


@dataclass(frozen=True)
class Adc:
    """Volts become codes: floor(pedestal + A·S + ½), clipped to 0 … 2^bits − 1 (paper eq. 10, 35).

    bits : resolution.  gain_dn_per_v : A = 2^bits/V_FS [DN/V].  black_level_dn : what darkness reads [DN].
    """

    bits: int
    gain_dn_per_v: float
    black_level_dn: float
    domain: ClassVar[str] = "DN"

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain."""
        return self.gain_dn_per_v

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing [V] → whole digital numbers (H, W), rounded half up."""
        highest = frame.number(self.highest)
        code = lambda x: arrays.minimum(arrays.maximum(arrays.floor(x + 0.5), 0.0), highest)  # noqa: E731
        return arrays.along(self._line, code, self._ideal(swing, frame))

    def _ideal(self, swing: Any, frame: Frame) -> Any:
        """What a converter of infinitely many bits would say [DN]."""
        return frame.number(self.black_level_dn) + frame.number(self.gain_dn_per_v) * swing

    def _line(self, ideal: Any, code: Any) -> Any:
        """What the steps follow, flat at both ends."""
        return arrays.where(ideal > 0, arrays.where(ideal < self.highest, ideal, self.highest), 0.0)

    def moments(self, m: Moments) -> Moments:
        """Gain and pedestal, then rounding (1/12 DN² where the noise hides the steps) and the clip at both ends."""
        return m.scale(self.gain_dn_per_v).add(mean=self.black_level_dn).round().clip(0.0, self.highest)

    @property
    def highest(self) -> int:
        """The largest code, 2^bits − 1."""
        return 2**self.bits - 1


@dataclass(frozen=True)
class AdcWithSteps(Adc):
    """A converter whose steps differ: transition levels T_k = (k − ½ + INL_k)·LSB, INL the running sum of the DNL.

    dnl_lsb : (2^bits,) width of every code less one [LSB], ≥ −1; −1 is a missing code, which never appears.
    """

    dnl_lsb: tuple[float, ...] = ()

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing [V] → the code whose step it falls into (H, W)."""
        code = lambda x: arrays.count_at_or_below(self._transitions, x)  # noqa: E731
        return arrays.along(self._line, code, self._ideal(swing, frame))

    def moments(self, m: Moments) -> Moments:
        """As a converter of equal steps, moved by the local INL and with the variance of steps of these widths."""
        ideal = m.scale(self.gain_dn_per_v).add(mean=self.black_level_dn)
        code = arrays.minimum(arrays.maximum(arrays.floor(ideal.mean + 0.5), 0.0), self.highest)
        inl = arrays.pick(self._inl, arrays.index(code))
        return ideal.add(mean=-inl).round().clip(0.0, self.highest)

    @property
    def _inl(self) -> tuple[float, ...]:
        """INL at the lower edge of every code [LSB]."""
        return tuple(accumulate(self.dnl_lsb, initial=0.0))[:-1]

    @property
    def _transitions(self) -> tuple[float, ...]:
        """Edges between code k − 1 and k, k = 1 … 2^bits − 1 [DN]."""
        return tuple(k - 0.5 + inl for k, inl in enumerate(self._inl) if k)
