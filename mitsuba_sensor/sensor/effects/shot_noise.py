"""Shot noise: whole electrons, Poisson(photoelectrons) + Poisson(dark electrons)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...core import Array, Electrons, Frame, Moments, arrays
from ..compensation import compensable, counted
from ..stage import Datasheet, Stage


@dataclass(frozen=True)
class ShotNoise(Stage):
    """Poisson(light) + Poisson(dark), in *detected* electrons (paper eq. 13, 17 corrected).

    Thinning a Poisson stream of photons by QE leaves a Poisson stream, so var/mean = 1 here, not QE.

    Where the mean is that of a render with a known variance, one render per frame, the counts vary by that much less
    about it (compensation.py). Over frames with renders of their own var/mean is 1 again; about its own render less.
    """

    domain = "electrons"
    paper = "eq. 13, 17"
    counts_electrons: ClassVar[bool] = True

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> ShotNoise:
        """Every camera has it."""
        return cls()

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → whole electrons."""
        if electrons.variance_e2 is not None:
            return self._compensated(electrons, frame)
        light = frame.poisson("photon_shot", electrons.light)
        dark = frame.poisson("dark_shot", electrons.dark) if arrays.any_positive(electrons.dark) else 0.0
        return replace(electrons, light=light, dark=dark)

    def moments(self, m: Moments) -> Moments:
        """The temporal variance is the mean; about its own render a frame varies less by what is compensated."""
        if m.variance_e2 is None:
            return m.add(temporal=m.mean)
        light = (m.light or m).mean
        by_light, by_dark = compensable(light, m.mean - light, m.variance_e2)
        return replace(m.add(temporal=m.mean - by_light - by_dark), variance_e2=None)

    def noise_sources(self, before: Electrons, after: Electrons) -> dict[str, tuple[Array, Array]]:
        """Photon shot noise and dark shot noise apart; the variance of each is its mean, less what it compensates."""
        noise = before.variance_e2
        less = (0.0, 0.0) if noise is None else compensable(before.light, before.dark, noise)
        parts = {"photon shot noise": "light", "dark shot noise": "dark"}
        means, counts = ([getattr(one, part) for part in parts.values()] for one in (before, after))
        changes = [np.subtract(n, mean, dtype=np.float64) for n, mean in zip(counts, means, strict=True)]
        return {name: (x, mean - by) for name, x, mean, by in zip(parts, changes, means, less, strict=True)}

    def _compensated(self, electrons: Electrons, frame: Frame) -> Electrons:
        """The same where a part of the variance is in the mean already."""
        by_light, by_dark = compensable(electrons.light, electrons.dark, electrons.variance_e2)
        light = counted("photon_shot", electrons.light, by_light, frame)
        dark = 0.0
        if arrays.any_positive(electrons.dark):
            dark = counted("dark_shot", electrons.dark, by_dark, frame)
        return replace(electrons, light=light, dark=dark, variance_e2=None)
