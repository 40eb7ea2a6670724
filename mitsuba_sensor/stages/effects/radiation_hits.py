"""Radiation hits: cosmic rays and other charged particles leave charge in random pixels of each frame.

The charge that a fast particle frees in a thin layer has Landau's distribution; Moyal, Phil. Mag. 46, 263 (1955), gives
the closed form that is used here. Flux at sea level: about 1 muon per cm² and minute (Particle Data Group).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core import Electrons, Frame, arrays
from ..datasheet import FileTable, NotNegative, optional
from ..stage import Datasheet, Stage

SCALE = 0.15
"""Scale of Moyal's distribution over the most probable charge. Its full width at half maximum is 3.59 times as large:
0.54, the value of Bichsel, Rev. Mod. Phys. 60, 663 (1988), for some ten micrometres of silicon."""

CM2_PER_UM2 = 1e-8
MEAN = float(np.euler_gamma) + math.log(2)
"""Mean of Moyal's distribution of location 0 and scale 1."""


class RadiationHitsFields(FileTable):
    """Charged particles that cross the sensor."""

    hits_per_cm2_s: NotNegative = optional(
        "charged particles that cross the sensor [1/(cm² s)]; about 0.017 at sea level",
        0.017,
        0.0,
        title="cosmic rays, radiation hits",
    )
    hit_e: Annotated[float, Field(gt=0, le=1e7, strict=True)] = optional(
        "most probable charge of a hit [e-]; 64 to 75 per µm of silicon",
        1500.0,
        1500.0,
        title="most probable charge of a hit",
    )


@dataclass(frozen=True)
class RadiationHits(Stage):
    """Charge of Moyal's distribution in the pixels that charged particles cross in this frame.

    Poisson(flux·area·t) particles cross a pixel. One leaves hit_e·(1 − 0.15·ln Z²) electrons, Z standard normal (Moyal
    1955): most probably hit_e, on average 1.19·hit_e, with a long tail. For several in one pixel, mean and variance of
    the sum are exact. Hits add after the full well. Tracks through several pixels are not modelled.

    hits_per_um2_s : flux.  hit_e : most probable charge.  pixel_um2 : area of a pixel.
    """

    hits_per_um2_s: float
    hit_e: float
    pixel_um2: float
    domain = "electrons"
    table = "pixel"
    fields = RadiationHitsFields
    label = "radiation hits"
    terms = "cosmic rays, radiation hits, Landau distribution (Moyal 1955)"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> RadiationHits | None:
        """Return None for a camera without hits."""
        pixel = camera.pixel
        if not pixel.hits_per_cm2_s:
            return None
        area_um2 = pixel.pitch_x_um * pixel.pitch_y_um
        return cls(pixel.hits_per_cm2_s * CM2_PER_UM2, pixel.hit_e, area_um2)

    @property
    def mean_e(self) -> float:
        """Mean charge of a hit [e-], the mean of Moyal's distribution, location + scale·(γ + ln 2)."""
        return self.hit_e * (1 + SCALE * MEAN)

    def mean_hits(self, frame: Frame) -> float:
        """Return the mean number of particles that cross a pixel in this exposure."""
        return self.hits_per_um2_s * self.pixel_um2 * frame.exposure.time_s

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return the electrons with those of the hits, as dark electrons."""
        mean_hits = self.mean_hits(frame)
        if mean_hits == 0:
            return electrons
        hits = frame.poisson("radiation_hit", frame.number(mean_hits))
        above = frame.window.backend.moyal(frame.random_bits("radiation_charge")) - MEAN
        spread = frame.number(SCALE * self.hit_e) * (arrays.sqrt(hits) * above)
        added = arrays.floor(hits * frame.number(self.mean_e) + spread + 0.5)
        return electrons.changed(
            lambda total: total + added, lambda light, dark: (light, dark + added)
        )
