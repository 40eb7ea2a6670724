"""Image lag: electrons that the transfer to the sense node leaves behind, which the next frame shows.

Fossum, IEEE Workshop on CCDs and Advanced Image Sensors (2003), "Charge transfer noise and lag in CMOS active pixel
sensors". Each electron stays with the same probability. A Poisson stream divided at random among frames gives
independent Poisson streams, as for crosstalk: only the means are mixed, and the noise of two frames has no covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Self

from pydantic import Field, model_validator

from ..core import Electrons
from .datasheet import FileTable, optional
from .effects.full_well import held_e
from .effects.quantum_yield import bursts
from .stage import Datasheet

BEFORE = "before"
"""Name of the previous frame's light in ``Photons.by_readout``."""


class ImageLagFields(FileTable):
    """Photoelectrons that are read with the next frame."""

    image_lag: Annotated[float, Field(ge=0, le=0.5, strict=True)] = optional(
        "fraction of a pixel's photoelectrons that is read with the next frame of a series",
        0.01,
        0.0,
        title="image lag, residual charge",
    )

    @model_validator(mode="after")
    def _electrons_stay_one_by_one(self) -> Self:
        if self.image_lag and bursts(getattr(self, "quantum_yield", None)):
            raise ValueError(
                "give either image_lag or quantum_yield, not both: image_lag divides electrons independently"
            )
        return self


@dataclass(frozen=True)
class ImageLag:
    """A fraction of the charge of each frame is read with the next frame, and none later.

    fraction : of the electrons that stay.  full_well_e, knee_e : what a pixel holds.
    """

    fraction: float
    full_well_e: float
    knee_e: float

    @classmethod
    def from_camera(cls, camera: Datasheet) -> ImageLag | None:
        """Return None for a camera without lag."""
        fraction, pixel = camera.quantum_efficiency.image_lag, camera.pixel
        if not fraction:
            return None
        return cls(fraction, pixel.full_well_e, pixel.full_well_knee_e)

    def shown(self, electrons: Electrons, before: Electrons) -> Electrons:
        """Return the mean photoelectrons of a frame with those from the previous frame, without those for the next.

        Where both frames are equal the result is exact.
        """
        held, held_before = (
            held_e(one.light, self.full_well_e, self.knee_e) for one in (electrons, before)
        )
        return replace(electrons, light=electrons.light + self.fraction * (held_before - held))
