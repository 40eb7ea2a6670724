"""Blooming: charge that a full pixel cannot hold flows along its column into its neighbours.

Janesick, Scientific CCDs (2001), section 4.2.4: the channel stops hold charge in its column; an
antiblooming drain removes a fraction of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import model_validator

from ...core import Array, Electrons, Frame, arrays
from ...core.types import NumpyArray
from ..datasheet import Chance, FileTable, optional
from ..stage import Datasheet, Stage

WHOLE_COLUMN_PX = 10**6
"""Most rows of a sensor."""


class BloomingFields(FileTable):
    """Charge above the full well."""

    blooming: Chance = optional(
        "fraction of the charge above full_well_e that flows along the column; the rest is drained",
        1.0,
        0.0,
        title="blooming, antiblooming",
    )

    @model_validator(mode="after")
    def _wells_clip(self) -> Self:
        knee_e = getattr(self, "full_well_knee_e", 0.0)
        if self.blooming and knee_e:
            raise ValueError(
                f"blooming is {self.blooming:g} and full_well_knee_e is {knee_e:g}; set one of them to 0: with a knee, "
                "charge goes to the drain before it can flow along the column"
            )
        return self


@dataclass(frozen=True)
class Blooming(Stage):
    """Half of the charge above the full well flows up its column, half down, until wells that are not full collect it.

    Nothing is random. Full wells pass charge on; what reaches the first or last row of the window is lost.

    full_well_e : what a pixel holds [e-].  fraction : of the charge above that flows; the rest is drained.
    """

    full_well_e: float
    fraction: float
    domain = "electrons"
    table = "pixel"
    fields = BloomingFields
    terms = "blooming, antiblooming (J)"
    no_noise = "set pixel.blooming to 0"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Blooming | None:
        """Return None for a camera that drains all of it."""
        if not camera.pixel.blooming:
            return None
        return cls(camera.pixel.full_well_e, camera.pixel.blooming)

    @property
    def reach_px(self) -> int:
        """The whole column."""
        return WHOLE_COLUMN_PX

    @property
    def reach_along_rows_px(self) -> int:
        """Charge stays in its column."""
        return 0

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the electrons after the flow; charge that flowed counts as photoelectrons."""
        backend, window = frame.window.backend, frame.window

        def flown(count: Array) -> Array:
            on_host = np.broadcast_to(backend.to_numpy(count, window), window.shape)
            if not (on_host > self.full_well_e).any():
                return count
            return backend.from_numpy(self._flown(on_host), window)

        def parts(light: Array, dark: Array) -> tuple[Array, Array]:
            held = arrays.minimum(dark, frame.number(self.full_well_e))
            return flown(light + dark) - held, held

        return electrons.changed(flown, parts)

    def _flown(self, count: NumpyArray) -> NumpyArray:
        """Return the charge of every pixel, (H, W) float64, on NumPy."""
        wells = np.minimum(count, self.full_well_e).astype(np.float64)
        above = np.floor(self.fraction * (count.astype(np.float64) - wells))
        downwards = np.floor(above / 2)
        self._fill(wells, downwards)
        self._fill(wells[::-1], (above - downwards)[::-1])
        return wells

    def _fill(self, wells: NumpyArray, above: NumpyArray) -> None:
        """Add the flow from the first row to the last to wells that are not full.

        wells, above : charge of every pixel, and the charge that leaves it in this direction, (H, W).
        """
        flowing = np.zeros(wells.shape[1])
        for well, own in zip(wells, above, strict=True):
            taken = np.minimum(flowing, self.full_well_e - well)
            well += taken
            flowing += own - taken
