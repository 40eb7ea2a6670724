"""Column PRNU (PRNU_col): a fixed gain of every column amplifier."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pydantic import Field

from ...core import arrays
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.types import Array
from ..datasheet import LineCoupling, NotNegative, Section
from ..stage import Datasheet, Stage, cut_to_zero


class PrnuColumnFields(Section):
    """Gains of the columns."""

    prnu_col: NotNegative = Field(0.0, description="spread of the column gains, σ over 1", examples=[0.002])
    prnu_col_coupling: LineCoupling = Field(0.0, description="coupling a of the column gains", examples=[0.25])


@dataclass(frozen=True)
class PrnuColumn(Stage):
    """S·(1 + cv·x_j), x_j isotropic AR of variance 1 (paper eq. 28). A CCD has none.

    cv : σ of the gain over its mean.  coupling : a of the AR process, 0 … 0.4999.
    """

    cv: float
    coupling: float = 0.0
    domain = "volts"
    table = "readout"
    fields = PrnuColumnFields
    paper = "eq. 28"
    label = "PRNU column"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> PrnuColumn | None:
        """None for a CCD, which has one amplifier."""
        if camera.sensor.technology == "ccd":
            return None
        return cls(camera.readout.prnu_col, camera.readout.prnu_col_coupling)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing times the gains of the columns."""
        if self.cv == 0 and "prnu_col" not in frame.window.given:
            return swing
        return swing * self.fpn_maps(frame.window)["prnu_col"]

    def moments(self, m: Moments) -> Moments:
        """Product of independent factors: the gain's spread acts on the signal's own as well."""
        mean, variance = m.frame.window.map_moments("prnu_col", 1.0, self.cv**2)
        if variance == 0:
            return m.scale(mean)
        squared = mean**2 + variance
        spatial = m.spatial * squared + arrays.product(m.mean**2, variance)
        return replace(m, mean=m.mean * mean, temporal=m.temporal * squared, spatial=spatial)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """``prnu_col``: gain of every column, 1 on average, (1, W)."""
        return {"prnu_col": window.measured_or("prnu_col", lambda: self._gains(window))}

    def counts(self, signal: Array, maps: dict[str, Array]) -> dict[str, int]:
        """Columns whose gain is not positive."""
        return cut_to_zero(maps, "prnu_col")

    def _gains(self, window: SensorWindow) -> Array:
        return 1 + window.number(self.cv) * window.line_map("prnu_col", self.coupling)
