"""Image lag: electrons that the transfer to the sense node leaves behind, which the next frame shows.

Fossum, IEEE Workshop on CCDs and Advanced Image Sensors (2003), "Charge transfer noise and lag in CMOS active pixel
sensors". Each electron stays behind by its own chance. Electrons of a Poisson stream that are shared out among frames
are Poisson streams and independent, as those that crosstalk shares out among pixels: only the means are mixed, and the
noise of two frames has no covariance.
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
"""Name of the light of the frame before, among that of other exposures (:class:`Photons`)."""


class ImageLagFields(FileTable):
    """Photoelectrons that are read with the next frame."""

    image_lag: Annotated[float, Field(ge=0, le=0.5, strict=True)] = optional(
        "share of a pixel's photoelectrons that its read-out leaves behind for the next frame, of frames "
        "that follow each other in time; a frame without the light of the one before (no fps, data sets) shows no lag",
        0.01,
        0.0,
        title="image lag, residual charge",
    )

    @model_validator(mode="after")
    def _electrons_stay_one_by_one(self) -> Self:
        if self.image_lag and bursts(getattr(self, "quantum_yield", None)):
            raise ValueError(
                "give either image_lag or quantum_yield, and not both: electrons of one photon stay one by one"
            )
        return self


@dataclass(frozen=True)
class ImageLag:
    """A share of the charge of each frame is missing in it and is part of the next one; none of it stays for longer.

    share : of the electrons that stay behind.  full_well_e, knee_e : of what a pixel holds of its electrons.
    """

    share: float
    full_well_e: float
    knee_e: float

    @classmethod
    def from_camera(cls, camera: Datasheet) -> ImageLag | None:
        """None for a camera whose read-out leaves nothing behind."""
        share, pixel = camera.quantum_efficiency.image_lag, camera.pixel
        if not share:
            return None
        return cls(share, pixel.full_well_e, pixel.full_well_knee_e)

    def shown(self, electrons: Electrons, before: Electrons) -> Electrons:
        """Mean photoelectrons of a frame, with those of the frame before and without those that stay for the next.

        What is equal in both frames stays as it is, to the last bit.
        """
        held, held_before = (
            held_e(one.light, self.full_well_e, self.knee_e) for one in (electrons, before)
        )
        return replace(electrons, light=electrons.light + self.share * (held_before - held))
