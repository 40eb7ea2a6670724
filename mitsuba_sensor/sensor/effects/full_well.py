"""Full well: a pixel holds at most its saturation capacity of electrons (EMVA 1288 μ_e.sat)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import Field

from ...core import Array, Electrons, Frame, Moments, arrays
from ..datasheet import FileTable
from ..stage import Datasheet, Stage


class FullWellFields(FileTable):
    """Saturation capacity."""

    full_well_e: Annotated[float, Field(ge=1, le=1e30, strict=True)] = Field(
        description="saturation capacity [e-]", examples=[33000]
    )


@dataclass(frozen=True)
class FullWell(Stage):
    """min(N, full well), before any read noise (paper, text after eq. 26).  full_well_e : saturation capacity [e-]."""

    full_well_e: float
    domain = "electrons"
    table = "pixel"
    fields = FullWellFields
    paper = "text after eq. 26"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> FullWell:
        """The saturation capacity of the datasheet."""
        return cls(camera.pixel.full_well_e)

    @property
    def saturation_e(self) -> float:
        """The full well [e-]."""
        return self.full_well_e

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Clips the sum; the excess is taken from the photoelectrons."""
        capacity = frame.number(self.full_well_e)
        dark = arrays.minimum(electrons.dark, capacity)
        return replace(electrons, light=arrays.minimum(electrons.light, capacity - dark), dark=dark)

    def moments(self, m: Moments) -> Moments:
        """A clipped normal: shot noise near a full well is one."""
        return m.clip(-float("inf"), self.full_well_e)

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Pixels that are full."""
        return {"clipped_full_well": signal >= frame.number(self.full_well_e)}
