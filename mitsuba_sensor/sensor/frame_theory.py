"""Theory of the pixels of one window: averages over all of them, and the moments of each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Frame
from ..core.types import Float64Array
from .detection import Detected
from .light_levels import LightLevels, light_levels
from .run import row_strips_of
from .stage import Chain, Stage
from .theory import Theory
from .threads import for_each
from .uncounted import shared_theory_of

STRIP = 2**16
"""Pixels that are looked up together."""


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
        return [shared_theory_of(self.stages, self.frame, levels.kind, levels.light_e) for levels in self.levels]

    def averages(self, stage: Stage) -> Averages:
        """Behind a stage."""
        pixels = np.concatenate([levels.pixels for levels in self.levels])
        found = [theory.behind(stage, one.light_e) for theory, one in zip(self.theories, self.levels, strict=True)]
        parts = (np.concatenate(values) for values in zip(*found, strict=True))
        return Averages(*(float(np.average(part, weights=pixels)) for part in parts))

    def means(self, light_e: Float64Array) -> dict[int, Float64Array]:
        """Expected signal behind every stage, by its number, in pixels with so many mean photoelectrons.

        From tables of the kind that most pixels are of.
        """
        return self._of_most.means(light_e)

    def digital_mean(self) -> NDArray[np.float32]:
        """Expected digital number of every pixel over frames and cameras, (H, W) [DN], strip by strip."""
        return self._digital("mean")

    def digital_variance(self) -> NDArray[np.float32]:
        """Temporal variance of every pixel, averaged over cameras, (H, W) [DN²], strip by strip."""
        return self._digital("temporal")

    def _digital(self, part: Literal["mean", "temporal"]) -> NDArray[np.float32]:
        theory = self._of_most
        theory.prepare([len(self.stages) - 1])
        found = np.empty(self.frame.window.shape, np.float32)

        def write(rows: slice) -> None:
            light_e = self.light.crop_rows(rows).mean_e
            found[rows] = getattr(theory.digital(light_e), part).reshape(light_e.shape)

        for_each(write, row_strips_of(found.shape, STRIP))
        return found

    @property
    def _of_most(self) -> Theory:
        """Of the kind that most pixels are of; a kind changes variances, and means by next to nothing."""
        return self.theories[max(range(len(self.levels)), key=lambda k: self.levels[k].pixels.sum())]
