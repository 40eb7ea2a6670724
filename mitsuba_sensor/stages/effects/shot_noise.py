"""Shot noise: whole electrons, Poisson(photoelectrons) + Poisson(dark electrons)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from ...core import CountedElectrons, Electrons, Frame, arrays
from ..datasheet import FileTable, Positive, optional
from ..stage import Datasheet, ElectronCounter

PartOfExposure = Annotated[float, Field(gt=0, le=0.9999, strict=True)]
RESETS_MAX = 3
SOURCES = ("photon_shot", "shot_behind_reset_1", "shot_behind_reset_2", "shot_behind_reset_3")
"""Random streams of the parts of an exposure with partial resets."""

LEFT, RIGHT = "left", "right"
"""Photodiodes of a dual pixel: names of their random streams and readouts."""


class ResetFields(FileTable):
    """Partial resets of the well during the exposure."""

    partial_resets: Annotated[
        tuple[tuple[PartOfExposure, Positive], ...], Field(max_length=RESETS_MAX)
    ] = optional(
        "partial resets, for a piecewise linear response: fraction of the exposure time, and "
        "electrons that stay [e-]",
        [[0.9, 8000]],
        (),
        title="piecewise-linear response, knee, multi-slope, well reset",
    )

    @model_validator(mode="after")
    def _resets_follow_each_other(self) -> Self:
        resets = self.partial_resets
        for (first, level_e), (later, higher_e) in pairwise(resets):
            if later <= first or higher_e <= level_e:
                raise ValueError(
                    f"partial_resets has [{later:g}, {higher_e:g}] after [{first:g}, {level_e:g}]; each must come "
                    "later and leave more electrons than the previous one"
                )
        return self


@dataclass(frozen=True)
class ShotNoise(ElectronCounter):
    """Poisson(light) + Poisson(dark), in *detected* electrons (paper eq. 13, 17 corrected).

    They are drawn as one Poisson(light + dark). If they are needed separately, each electron of that count is a dark
    electron with probability dark/(light + dark); the count stays the same.

    A Poisson stream of photons thinned by QE is a Poisson stream, so var/mean is 1, not QE.
    """

    domain = "electrons"
    table = "pixel"
    fields = ResetFields
    terms = "photon shot noise, dark shot noise, Poisson noise"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> ShotNoise:
        """Return the shot noise of dual pixels, of partial resets, or of plain pixels."""
        if camera.sensor.dual_pixel:
            return DualPixelShotNoise()
        if camera.pixel.partial_resets:
            return ShotNoiseWithResets(camera.pixel.partial_resets)
        return cls()

    def sample(self, mean: Electrons, frame: Frame) -> Electrons:
        """Return Poisson counts, of light and dark current together unless light is interactions."""
        light, dark = mean.light, mean.dark
        if not arrays.any_positive(dark):
            return replace(mean, light=frame.poisson("photon_shot", light), dark=0.0)
        if not isinstance(mean.yield_mean, float):
            return replace(
                mean,
                light=frame.poisson("photon_shot", light),
                dark=frame.poisson("dark_shot", dark),
            )
        count = frame.poisson("photon_shot", light + dark)
        return CountedElectrons(count, lambda: frame.split("dark_shot", count, light, dark))


@dataclass(frozen=True)
class DualPixelShotNoise(ShotNoise):
    """Sum of the Poisson counts of the two photodiodes of a dual pixel, each as in its own readout.

    The sum has the distribution of one photodiode. Each has half of the dark current.
    """

    label = ShotNoise.label

    @classmethod
    def key(cls) -> str:
        """Return the key of ShotNoise."""
        return ShotNoise.key()

    def sample(self, mean: Electrons, frame: Frame) -> Electrons:
        """Return whole electrons of both photodiodes."""
        half, light = frame.number(0.5), mean.light
        share = half if mean.left_share is None else mean.left_share
        dark = half * mean.dark
        of_left = replace(mean, light=share * light, dark=dark)
        of_right = replace(mean, light=(1 - share) * light, dark=dark)
        left = super().sample(of_left, replace(frame, charge=LEFT, _blocks={}))
        right = super().sample(of_right, replace(frame, charge=RIGHT, _blocks={}))
        return CountedElectrons(
            left.total + right.total,
            lambda: (left.light + right.light, left.dark + right.dark),
        )


@dataclass(frozen=True)
class ShotNoiseWithResets(ShotNoise):
    """Poisson counts of the parts of the exposure between partial resets of the well.

    n = min(n + Poisson(μ·Δt), level) at each reset: the response is piecewise linear, and after the last reset the
    variance is that of the electrons since then.  resets : fraction of the exposure time, and level [e-], of each.
    """

    resets: tuple[tuple[float, float], ...] = ()
    label = ShotNoise.label
    is_poisson: ClassVar[bool] = False

    def sample(self, mean: Electrons, frame: Frame) -> Electrons:
        """Return whole electrons."""
        begin, left, mean_e = 0.0, 0.0, mean.total
        for number, (end, level_e) in enumerate(self.resets):
            left = left + frame.poisson(SOURCES[number], frame.number(end - begin) * mean_e)
            left, begin = arrays.minimum(left, frame.number(level_e)), end
        last = SOURCES[len(self.resets)]
        count = left + frame.poisson(last, frame.number(1 - begin) * mean_e)
        return CountedElectrons(
            count, lambda: frame.split("dark_shot", count, mean.light, mean.dark)
        )


def left_by_resets(resets: tuple[tuple[float, float], ...], mean_e: float) -> float:
    """Return the electrons at the end of an exposure with these resets, without noise."""
    begin, left = 0.0, 0.0
    for end, level_e in resets:
        left, begin = min(left + (end - begin) * mean_e, level_e), end
    return left + (1 - begin) * mean_e
