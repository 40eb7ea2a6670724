"""Row fixed-pattern noise (row FPN, DSNU_row): a fixed offset of every row, horizontal stripes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from ...core.sensor_window import SensorWindow
from ...core.types import Array
from ..datasheet import LineCoupling, NotNegative, Section
from ..fixed_offset import FixedOffset
from ..gains import sense_gain_v_per_e
from ..stage import Stage

if TYPE_CHECKING:
    from ..camera import Camera


class DsnuRowFields(Section):
    """Offsets of the rows."""

    dsnu_row: NotNegative = Field(0.0, description="row offsets, σ over the full-well swing", examples=[0.0005])
    dsnu_row_coupling: LineCoupling = Field(0.0, description="coupling a of neighbouring rows", examples=[0.25])


@dataclass(frozen=True)
class DsnuRow(FixedOffset):
    """One offset per row, isotropic AR along the column (paper eq. 28). A CCD has none."""

    source: ClassVar[str] = "dsnu_row"
    table = "readout"
    fields = DsnuRowFields
    paper = "eq. 28"
    label = "DSNU row"

    @classmethod
    def from_camera(cls, camera: Camera, before: tuple[Stage, ...]) -> DsnuRow | None:
        """σ is a fraction of the full well. None for a CCD, which has one amplifier."""
        if camera.sensor.technology == "ccd":
            return None
        readout, per_e = camera.readout, sense_gain_v_per_e(camera) * camera.source_follower.gain
        return cls(readout.dsnu_row * camera.pixel.full_well_e, per_e, readout.dsnu_row_coupling)

    def unit_map(self, window: SensorWindow) -> Array:
        """(H, 1), variance 1."""
        return window.line_map(self.source, self.coupling, axis=0)
