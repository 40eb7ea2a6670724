"""Theory of the pixels of one window: averages over all of them, and the moments of each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..core import Frame
from ..core.types import Float64Array
from .detection import Detected
from .light_levels import LightLevels, light_levels
from .stage import Chain, Stage
from .theory import Theory
from .uncounted import theory_of


class Averages(NamedTuple):
    """Mean, temporal and spatial variance of a signal, averaged over the pixels, in the unit of its stage."""

    mean: float
    temporal: float
    spatial: float

    @property
    def sigma(self) -> float:
        """Root of both variances together."""
        return float(np.sqrt(self.temporal + self.spatial))


@dataclass(frozen=True, eq=False)
class FrameTheory:
    """Theory of one light on one chain.

    light, frame : of the window, and its exposure, place and measured maps.
    """

    stages: Chain
    light: Detected
    frame: Frame

    @cached_property
    def levels(self) -> list[LightLevels]:
        """The light that is there."""
        return light_levels(self.light)

    @cached_property
    def theories(self) -> list[Theory]:
        """One for each kind of light."""
        return [theory_of(self.stages, self.frame, levels.kind) for levels in self.levels]

    def averages(self, stage: Stage) -> Averages:
        """Behind a stage."""
        pixels = np.concatenate([levels.pixels for levels in self.levels])
        found = [theory.behind(stage, one.light_e) for theory, one in zip(self.theories, self.levels, strict=True)]
        parts = (np.concatenate(values) for values in zip(*found, strict=True))
        return Averages(*(float(np.average(part, weights=pixels)) for part in parts))

    def means(self, light_e: Float64Array) -> dict[int, Float64Array]:
        """Expected signal behind every stage, by its number, in pixels with so many mean photoelectrons.

        From tables of the kind that most pixels are of; a kind changes variances, and means by next to nothing.
        """
        theory = self.theories[max(range(len(self.levels)), key=lambda k: self.levels[k].pixels.sum())]
        return theory.means(light_e)
