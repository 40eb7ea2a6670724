"""Frames that each have a render of their own, with its noise on top or spent, and the exposure that shows both."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.exposure import Exposure
from ...core.signals import Photons
from ...render.passes import Welford
from ...render.per_frame import AIM, NOISIEST, UNCOMPENSATED
from ...render.statistics import median_bias
from ...sensor.chain import mean_dark_e
from ...sensor.compensation import compensable
from ...sensor.expose import expose
from .reference import Truth, mean_and_variance_dn2
from .series import Opened, Subject

if TYPE_CHECKING:
    from ...sensor.camera import Camera

PILOT = 8
"""Passes whose spread tells how noisy one is."""
FEWEST_SPENT = 8
"""Passes from which a measured variance is good enough to be spent (7 degrees of freedom, render/per_frame.py)."""
SPENT = 8
"""Or one in so many of a run's passes, with which the noise of a render shall just be compensable."""
DIMMER, DIMMEST = 2.0**-0.25, 2.0**-30
"""Steps in which the exposure is shortened, and where that ends: the noise of any render is compensable there."""


@dataclass(frozen=True)
class Framed:
    """The exposure at which frames are drawn: the given one, or a share of it that lets the render's noise be spent.

    Electrons go with the exposure, the variance of their mean with its square: so does a render's part of the noise.
    share : of the given exposure.  compensable : passes with which a render's noise is as low as spending aims at.
    noisiest : flat places of the pixels that are not looked at, because nobody can spend their noise.
    variance_dn2 : temporal, that frames must have, averaged over the others that are seen.  pixels : so many of equal
    variance would tell it as well.
    """

    time_s: float
    temperature_k: float
    share: float
    compensable: float
    noisiest: tuple[int, ...]
    variance_dn2: float
    pixels: float

    def to_dict(self) -> dict[str, float]:
        """Ready for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, found: Mapping[str, Any] | None) -> Framed | None:
        """What :meth:`to_dict` gave; None of None."""
        return None if found is None else cls(**found)

    def shown(self, truth: Truth) -> NDArray[np.bool_]:
        """Pixels whose frames are looked at, (H, W)."""
        seen = truth.scale.seen.copy()
        seen.flat[list(self.noisiest)] = False
        return seen

    def spread(self, frames: int, runs: int) -> float:
        """Relative standard error of a σ from so many frames of each run, of normal noise."""
        return math.sqrt(0.5 / (self.pixels * (frames - 1) * runs))

    def frame(
        self, camera: Camera, photons: Photons, run: int, number: int, variance_e2: NDArray[Any] | None = None
    ) -> NDArray[Any]:
        """The digital numbers of a frame, (H, W). variance_e2 : of the render, at the given exposure, to be spent."""
        light = replace(photons, mean=self.share * photons.mean)
        if variance_e2 is not None:
            light = replace(light, variance_e2=self.share**2 * variance_e2)
        exposure = Exposure(self.time_s, self.temperature_k)
        return expose(light, camera, exposure, seed=run, first_frame=number).digital[0]


@dataclass(frozen=True, eq=False)
class OnePass:
    """How noisy one pass is, in the pixels that are looked at, (N,).

    light_e, dark_e : mean electrons at the given exposure.  variance_e2 : of the light's, from pass to pass.
    """

    light_e: NDArray[np.float64]
    dark_e: float
    variance_e2: NDArray[np.float64]
    full_well_e: float

    def compensable(self, share: float, passes: float) -> bool:
        """Whether so many passes are quiet enough at a share of the exposure, as render/per_frame.py judges a render:
        by the median, and by what is left uncompensated; and whether the median pixel is below full well."""
        light, dark, variance = share * self.light_e, share * self.dark_e, share**2 * self.variance_e2 / passes
        total = np.maximum(light + dark, np.finfo(float).tiny)
        left = variance - sum(compensable(light, dark, variance))
        quiet = np.median(variance / total) * median_bias(PILOT) <= AIM and np.mean(left / total) <= UNCOMPENSATED
        return bool(quiet and np.median(total) < self.full_well_e)


def framed(subject: Subject, opened: Opened, truth: Truth, passes: int) -> Framed:
    """The exposure for runs of so many passes: the given one if an eighth of them is enough for spending there."""
    pilot, seen, dark_e = Welford(opened.shape), truth.scale.seen, mean_dark_e(subject.camera, subject.exposure)
    opened.each_pass(0, PILOT, lambda seconds, irradiance, electrons: pilot.add(electrons.copy()))
    noise = pilot.variance_of_mean / np.maximum(truth.electrons + dark_e, np.finfo(float).tiny)
    noisiest = seen & (noise > np.quantile(noise[seen], 1 - NOISIEST))
    shown = seen & ~noisiest
    variance_e2 = PILOT * pilot.variance_of_mean[shown]
    one = OnePass(truth.electrons[shown], dark_e, variance_e2, subject.camera.pixel.full_well_e)
    share, count = 1.0, max(passes / SPENT, FEWEST_SPENT)
    while not one.compensable(share, count) and share > DIMMEST:
        share *= DIMMER
    while count > FEWEST_SPENT and one.compensable(share, count / 2):
        count /= 2
    dimmed = Exposure(share * subject.exposure.time_s, subject.exposure.temperature_k)
    light = replace(truth.photons, mean=share * truth.photons.mean)
    variance = mean_and_variance_dn2(light, subject.camera, dimmed)[1][shown]
    pixels, places = float(variance.sum() ** 2 / (variance**2).sum()), tuple(np.flatnonzero(noisiest).tolist())
    return Framed(dimmed.time_s, dimmed.temperature_k, share, count, places, float(variance.mean()), pixels)
