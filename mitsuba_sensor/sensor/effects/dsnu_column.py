"""Column fixed-pattern noise (column FPN, DSNU_col): a fixed offset of every column, vertical stripes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from ...core.sensor_window import SensorWindow
from ...core.types import Array
from ..datasheet import Chance, LineCoupling, NotNegative, Section
from ..fixed_offset import FixedOffset
from ..gains import sense_gain_v_per_e
from ..stage import Stage

if TYPE_CHECKING:
    from ..camera import Camera


class DsnuColumnFields(Section):
    """Offsets of the columns."""

    dsnu_col: NotNegative = Field(0.0, description="column offsets, σ over the full-well swing", examples=[0.001])
    dsnu_col_coupling: LineCoupling = Field(0.0, description="coupling a of neighbouring columns", examples=[0.25])
    dsnu_residual: Chance = Field(
        1.0, description="share of column and pixel offsets that the analogue CDS leaves", examples=[1.0]
    )


@dataclass(frozen=True)
class DsnuColumn(FixedOffset):
    """One offset per column, isotropic AR along the row (paper eq. 28, 32). A CCD has none."""

    source: ClassVar[str] = "dsnu_col"
    table = "readout"
    fields = DsnuColumnFields
    paper = "eq. 28, 32"
    label = "DSNU column"

    @classmethod
    def from_camera(cls, camera: Camera, before: tuple[Stage, ...]) -> DsnuColumn | None:
        """σ is a fraction of the full well. None for a CCD, which has one amplifier."""
        if camera.sensor.technology == "ccd":
            return None
        readout, per_e = camera.readout, sense_gain_v_per_e(camera) * camera.source_follower.gain
        sigma_e = readout.dsnu_col * camera.pixel.full_well_e
        return cls(sigma_e, per_e, readout.dsnu_col_coupling, readout.dsnu_residual)

    def unit_map(self, window: SensorWindow) -> Array:
        """(1, W), variance 1."""
        return window.line_map(self.source, self.coupling, axis=1)
