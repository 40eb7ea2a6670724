"""Full well: a pixel holds at most its saturation capacity of electrons (EMVA 1288 μ_e.sat)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from pydantic import Field

from ...core import Array, Electrons, Frame, Moments, arrays
from ..datasheet import FileTable
from ..stage import Datasheet, Stage
from ..usual_range import THOUSANDS, Usual


class FullWellFields(FileTable):
    """Saturation capacity."""

    full_well_e: Annotated[
        float, Field(ge=1, le=1e30, strict=True), Usual.of(200, 1e8, THOUSANDS)
    ] = Field(description="saturation capacity [e-]", examples=[33000])


@dataclass(frozen=True)
class FullWell(Stage):
    """min(N, full well), before any read noise (paper, text after eq. 26).  full_well_e : saturation capacity [e-]."""

    full_well_e: float
    domain = "electrons"
    table = "pixel"
    fields = FullWellFields
    paper = "text after eq. 26"
    terms = "full well, saturation capacity μ_e.sat (E), S_FW (J), clipping"
    no_noise = "set pixel.full_well_e to a larger value"

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

        def beside(dark: Array, light: Array) -> Array:
            return arrays.with_gradient(
                arrays.minimum(light, capacity - dark), _line, light, dark, capacity
            )

        def parts(light: Array, dark: Array) -> tuple[Array, Array]:
            dark = arrays.minimum(dark, capacity)
            return beside(dark, light), dark

        return electrons.changed(partial(beside, 0.0), parts)

    def moments(self, m: Moments) -> Moments:
        """A clipped normal: shot noise near a full well is one."""
        return m.clip(-float("inf"), self.full_well_e)

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Pixels that are full."""
        return {"clipped_full_well": signal >= frame.number(self.full_well_e)}


def _line(light: Array, dark: Array, capacity: Array) -> Array:
    """Photoelectrons with derivatives that are right on average over whole counts n, also next to the full well.

    The mean over the counts grows by the step from n to n + 1, half of which is in the slope at n and half in that at
    n + 1: at the last count below the full well it is half a step and the part of a step that is left.
    """
    n, end = (arrays.detached(x) for x in (light + dark, capacity))
    last = arrays.where(n <= end, 0.5 + end - arrays.floor(end), 0.0)
    slope = arrays.where(n + 1.0 <= end, 1.0, last)
    full = arrays.where(n > end, 1.0, arrays.where(n < end, 0.0, 0.5))
    return light * slope - dark * (1.0 - slope) + capacity * full
