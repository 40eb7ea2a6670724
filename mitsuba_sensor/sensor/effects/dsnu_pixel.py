"""Pixel fixed-pattern noise (pixel FPN, DSNU_pixel): a fixed offset of every pixel (El Gamal et al. 1998)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from ...core.backend import normals
from ...core.sensor_window import SensorWindow
from ...core.types import Array
from ..datasheet import MapCoupling, NotNegative, Section
from ..fixed_offset import FixedOffset
from ..gains import sense_gain_v_per_e
from ..stage import Stage

if TYPE_CHECKING:
    from ..camera import Camera


class DsnuPixelFields(Section):
    """Offsets of the pixels."""

    dsnu_e: NotNegative = Field(0.0, description="pixel offsets, σ as electrons [e-]", examples=[2.0])
    dsnu_coupling: MapCoupling = Field(0.0, description="coupling a of neighbouring pixel offsets", examples=[0.25])


@dataclass(frozen=True)
class DsnuPixel(FixedOffset):
    """One offset per pixel, independent or separable isotropic AR (paper eq. 28). A CCD has none."""

    source: ClassVar[str] = "dsnu_pixel"
    table = "pixel"
    fields = DsnuPixelFields
    paper = "eq. 28"
    label = "DSNU pixel"

    @classmethod
    def from_camera(cls, camera: Camera, before: tuple[Stage, ...]) -> DsnuPixel | None:
        """None for a CCD, which has one amplifier."""
        if camera.sensor.technology == "ccd":
            return None
        pixel, per_e = camera.pixel, sense_gain_v_per_e(camera) * camera.source_follower.gain
        return cls(pixel.dsnu_e, per_e, pixel.dsnu_coupling, camera.readout.dsnu_residual)

    def unit_map(self, window: SensorWindow) -> Array:
        """(H, W), variance 1."""
        if self.coupling:
            return window.correlated(self.source, self.coupling)
        return window.fixed_map(self.source, normals)
