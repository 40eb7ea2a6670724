"""Shot noise: whole electrons, Poisson(photoelectrons) + Poisson(dark electrons)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...core import Array, CountedElectrons, Electrons, Frame, Moments, arrays
from ..compensation import compensable, reserved
from ..stage import Datasheet, Stage


@dataclass(frozen=True)
class ShotNoise(Stage):
    """Poisson(light) + Poisson(dark), in *detected* electrons (paper eq. 13, 17 corrected).

    The two are drawn as one Poisson(light + dark). Where they are needed apart, each electron of that count is a dark
    electron with chance dark/(light + dark), by a random number of its own: the count is the same.

    Thinning a Poisson stream of photons by QE leaves a Poisson stream, so var/mean = 1 here, not QE.

    Where the mean is that of a render with a known variance, one render per frame, the counts vary by that much less
    about it (compensation.py). Over frames with renders of their own var/mean is 1 again; about its own render less.
    """

    domain = "electrons"
    paper = "eq. 13, 17"
    terms = "photon shot noise, dark shot noise, Poisson noise"
    counts_electrons: ClassVar[bool] = True

    @classmethod
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> ShotNoise:
        """Every camera has it."""
        return cls()

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Mean electrons → whole electrons."""
        if electrons.variance_e2 is None:
            return self._counts(electrons, frame)
        light, dark = electrons.light, electrons.dark
        by_light, by_dark = compensable(light, dark, electrons.variance_e2)
        more_light, light = reserved(light, by_light, frame)
        more_dark, dark = (
            reserved(dark, by_dark, frame) if arrays.any_positive(dark) else (0.0, 0.0)
        )
        rest = self._counts(replace(electrons, light=light, dark=dark, variance_e2=None), frame)
        return rest.changed(
            lambda n: n + (more_light + more_dark), lambda n, d: (n + more_light, d + more_dark)
        )

    def moments(self, m: Moments) -> Moments:
        """The temporal variance is the mean; about its own render a frame varies less by what is compensated."""
        light, noise = m.light or m, m.variance_e2
        by_light, by_dark = (
            (0.0, 0.0) if noise is None else compensable(light.mean, m.mean - light.mean, noise)
        )
        counted = light.add(temporal=light.mean - by_light)
        return replace(
            m.add(temporal=m.mean - by_light - by_dark), light=counted, variance_e2=None
        )

    def noise_sources(
        self, before: Electrons, after: Electrons
    ) -> dict[str, tuple[Array, Array]]:
        """Photon shot noise and dark shot noise apart; the variance of each is its mean, less what it compensates."""
        noise = before.variance_e2
        if noise is None:
            less = (0.0, 0.0)
        else:
            less = compensable(before.light, before.dark, noise)
        parts = {"photon shot noise": "light", "dark shot noise": "dark"}
        means, counts = (
            [getattr(one, part) for part in parts.values()] for one in (before, after)
        )
        changes = [
            np.subtract(n, mean, dtype=np.float64)
            for n, mean in zip(counts, means, strict=True)
        ]
        return {
            name: (x, mean - by)
            for name, x, mean, by in zip(parts, changes, means, less, strict=True)
        }

    def _counts(self, mean: Electrons, frame: Frame) -> Electrons:
        """Poisson counts; of light and dark current as one, but where light is still interactions, not electrons."""
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
        return CountedElectrons.of(count, lambda: frame.split("dark_shot", count, light, dark))
