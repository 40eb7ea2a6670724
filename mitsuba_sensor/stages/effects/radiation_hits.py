"""Radiation hits: cosmic rays and other charged particles leave charge in single pixels, anew in every frame.

The charge that a fast particle frees in a thin layer has Landau's distribution; Moyal, Phil. Mag. 46, 263 (1955), gives
the closed form that is used here. Flux at sea level: about 1 muon per cm² and minute (Particle Data Group).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from ...core import Electrons, Frame, Moments, arrays
from ..datasheet import FileTable, NotNegative
from ..stage import Datasheet, PixelNoise, Stage

WIDTH = 0.15
"""Scale of Moyal's distribution, as a share of the most probable charge. Its full width at half maximum is 3.59 times
as large: 0.54, as Bichsel, Rev. Mod. Phys. 60, 663 (1988), has it for some ten micrometres of silicon."""

CM2_PER_UM2 = 1e-8


class RadiationHitsFields(FileTable):
    """Charged particles that cross the sensor."""

    hits_per_cm2_s: NotNegative = Field(
        0.0,
        title="cosmic rays, radiation hits",
        description="charged particles that cross the sensor [1/(cm² s)]; about 0.017 at sea level",
        examples=[0.017],
    )
    hit_e: Annotated[float, Field(gt=0, le=1e7, strict=True)] = Field(
        1500.0,
        title="most probable charge of a hit",
        description="electrons that most hits leave in their pixel [e-]; about 75 per µm of silicon",
        examples=[1500.0],
    )


@dataclass(frozen=True)
class RadiationHits(Stage):
    """Charge of Moyal's distribution in pixels that a charged particle crosses in this frame.

    A pixel is hit with chance 1 − e^(−flux·area·t), in each frame anew, and then gets hit_e·(1 − 0.15·ln Z²) electrons,
    Z a standard normal (Moyal 1955): hit_e most often, 1.19·hit_e on average, with a tail of many more. Particles that
    fly through several pixels are not simulated.

    hits_per_um2_s : flux.  hit_e : most probable charge.  pixel_um2 : area of a pixel.
    """

    hits_per_um2_s: float
    hit_e: float
    pixel_um2: float
    domain = "electrons"
    table = "pixel"
    fields = RadiationHitsFields
    label = "radiation hits"
    has_derivatives = False
    terms = "cosmic rays, radiation hits, Landau distribution (Moyal 1955)"

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> RadiationHits | None:
        """None for a camera without hits."""
        pixel = camera.pixel
        if not pixel.hits_per_cm2_s:
            return None
        area_um2 = pixel.pitch_x_um * pixel.pitch_y_um
        return cls(pixel.hits_per_cm2_s * CM2_PER_UM2, pixel.hit_e, area_um2)

    @property
    def mean_e(self) -> float:
        """Mean charge of a hit [e-]: that of Moyal's distribution, location + scale·(γ + ln 2)."""
        return self.hit_e * (1 + WIDTH * (float(np.euler_gamma) + math.log(2)))

    @property
    def variance_e2(self) -> float:
        """Variance of the charge of a hit [e-²]: ½(π·scale)², and 1/12 as whole electrons are counted."""
        return 0.5 * (math.pi * WIDTH * self.hit_e) ** 2 + 1 / 12

    def chance(self, frame: Frame) -> float:
        """Probability that a pixel is hit in this exposure."""
        return -math.expm1(-self.hits_per_um2_s * self.pixel_um2 * frame.exposure.time_s)

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Electrons with those of the hits; they count as dark electrons."""
        chance = self.chance(frame)
        if chance == 0:
            return electrons
        backend = frame.window.backend
        is_hit = backend.uniform(frame.random_bits("radiation_hit")) < chance
        above = backend.moyal(frame.random_bits("radiation_charge"))
        smooth = frame.number(self.hit_e) + frame.number(WIDTH * self.hit_e) * above
        charge = arrays.floor(smooth + 0.5)
        added = arrays.where(is_hit, charge, 0.0 * charge)
        return electrons.changed(
            lambda total: total + added, lambda light, dark: (light, dark + added)
        )

    def moments(self, m: Moments) -> Moments:
        """Mean p·μ and temporal variance p·(σ² + μ²) − (p·μ)² for a chance p and hits of mean μ and variance σ²."""
        chance = self.chance(m.frame)
        mean_e = chance * self.mean_e
        square_e2 = chance * (self.variance_e2 + self.mean_e**2)
        return m.add(mean=mean_e, temporal=square_e2 - mean_e**2)

    def pixel_noise(self, frame: Frame) -> PixelNoise | None:
        """A pixel is hit or not."""
        chance = self.chance(frame)
        if chance == 0:
            return None
        return PixelNoise(
            ((1 - chance, 0.0, 0.0), (chance, self.mean_e, self.variance_e2)),
        )
