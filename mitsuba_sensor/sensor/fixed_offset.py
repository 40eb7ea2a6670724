"""Fixed offset: what DSNU of columns, rows and pixels have in common, S + residual·gain·o with a fixed map o."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ..core.frame import Frame
from ..core.moments import Moments
from ..core.sensor_window import SensorWindow
from ..core.types import Array
from .stage import Stage


@dataclass(frozen=True)
class FixedOffset(Stage):
    """An offset that does not depend on the signal (paper eq. 28, 32).

    sigma_e : σ of the offsets, as electrons at the sense node.  gain_v_per_e : one electron at this stage [V/e-].
    coupling : a of the isotropic AR process.  residual : what the CDS leaves of the offsets, 0 … 1.
    source : name of the random stream; the map is called ``<source>_e``.
    """

    sigma_e: float
    gain_v_per_e: float
    coupling: float = 0.0
    residual: float = 1.0
    domain = "volts"
    source: ClassVar[str]

    @abstractmethod
    def unit_map(self, window: SensorWindow) -> Array:
        """The map with variance 1: (1, W), (H, 1) or (H, W)."""

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with the camera's offsets."""
        if self.sigma_e == 0 and self._name not in frame.window.given:
            return swing
        return swing + frame.number(self.residual * self.gain_v_per_e) * self.fpn_maps(frame.window)[self._name]

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the spatial variance."""
        mean, variance = m.frame.window.map_moments(self._name, 0.0, self.sigma_e**2)
        gain = self.residual * self.gain_v_per_e
        return m.add(mean=gain * mean, spatial=gain**2 * variance)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """The offsets in electrons, 0 on average."""
        return {self._name: window.measured_or(self._name, lambda: window.number(self.sigma_e) * self.unit_map(window))}

    @property
    def _name(self) -> str:
        return f"{self.source}_e"
