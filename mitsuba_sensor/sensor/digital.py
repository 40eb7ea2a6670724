"""The stage that digital numbers leave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..engine import arrays
from ..engine.frame import Frame
from ..engine.moments import Moments


@dataclass(frozen=True)
class Adc:
    """Volts become codes: floor(pedestal + A·S + ½), clipped to 0 … 2^bits − 1 (paper eq. 10, 35).

    bits : resolution.  gain_dn_per_v : A = 2^bits/V_FS [DN/V].  pedestal_dn : what darkness reads [DN].
    """

    bits: int
    gain_dn_per_v: float
    pedestal_dn: float
    room: ClassVar[str] = "digital numbers"

    def __call__(self, swing: Any, frame: Frame) -> Any:
        """Swing [V] → whole digital numbers (H, W), rounded half up."""
        code = arrays.floor(self.pedestal_dn + self.gain_dn_per_v * swing + 0.5)
        return arrays.minimum(arrays.maximum(code, 0.0), self.highest)

    def moments(self, m: Moments) -> Moments:
        """Gain, pedestal, then rounding's 1/12 DN² and the clip at both ends."""
        return m.scale(self.gain_dn_per_v).add(mean=self.pedestal_dn, temporal=1 / 12).clip(0.0, self.highest)

    @property
    def highest(self) -> int:
        """The largest code, 2^bits − 1."""
        return 2**self.bits - 1
