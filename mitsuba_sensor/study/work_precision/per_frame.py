"""Frames that each have a render of their own, with its noise on top or compensated, at an exposure that shows both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.exposure import Exposure
from ...core.signals import Photons
from ...render.passes import Welford
from ...render.per_frame import NOISIEST, TARGET, UNCOMPENSATED
from ...render.statistics import median_bias
from ...sensor.camera import Camera
from ...sensor.chain import chain
from ...sensor.compensation import compensable
from ...sensor.effects.dark_current import mean_dark_e
from ...sensor.expose import expose
from ..frames import expected_moments
from ..statistics import Array
from ..subject import Subject
from .reference import Target
from .series import Series

PILOT = 8  # passes whose spread tells how noisy one is
FEWEST_COMPENSATED = 8
"""Passes from which a measured variance can be compensated (7 degrees of freedom, render/per_frame.py)."""
COMPENSATED = 8  # or one in so many of a run's passes, with which the noise of a render shall just be compensable
DIMMER, DIMMEST = 2.0**-0.25, 2.0**-30
"""Steps in which the exposure is shortened, and where that ends: the noise of any render is compensable there."""


@dataclass(frozen=True, eq=False)
class FrameExposure:
    """The exposure at which frames are made: the given one, or a share of it at which render noise can be compensated.

    Electrons go with the exposure, the variance of their mean with its square: so does a render's part of the noise.
    share : of the given exposure.  compensable : passes after which render noise is as low as compensation aims at.
    noisiest : pixels that are not looked at, because nobody can compensate their noise, (H, W).
    variance_dn2 : temporal, that frames must have, averaged over the others that are seen.  pixels : so many of equal
    variance would tell it as well.
    """

    exposure: Exposure
    share: float
    compensable: float
    noisiest: NDArray[np.bool_]
    variance_dn2: float
    pixels: float

    def shown(self, target: Target) -> NDArray[np.bool_]:
        """Pixels whose frames are looked at, (H, W)."""
        return target.scale.seen & ~self.noisiest

    def spread(self, frames: int, runs: int) -> float:
        """Relative standard error of a σ from so many frames of each run, of normal noise."""
        return math.sqrt(0.5 / (self.pixels * (frames - 1) * runs))

    def frame(self, camera: Camera, photons: Photons, run: int, number: int) -> NDArray[Any]:
        """The digital numbers of a frame, (H, W). photons : at the given exposure; their variance is compensated."""
        variance_e2 = None if photons.variance_e2 is None else self.share**2 * photons.variance_e2
        light = replace(photons, mean=self.share * photons.mean, variance_e2=variance_e2)
        return np.asarray(expose(light, camera, self.exposure, seed=run, first_frame=number).digital[0])


@dataclass(frozen=True, eq=False)
class OnePass:
    """How noisy one pass is, in the pixels that are looked at, (N,).

    light_e, dark_e : mean electrons at the given exposure.  variance_e2 : of the light's, from pass to pass.
    """

    light_e: Array
    dark_e: float
    variance_e2: Array
    full_well_e: float

    def compensable(self, share: float, passes: float) -> bool:
        """Whether so many passes are quiet enough at a share of the exposure, as render/per_frame.py decides: by the
        median, and by what is left; and whether the median pixel is below full well."""
        light, dark, variance = share * self.light_e, share * self.dark_e, share**2 * self.variance_e2 / passes
        total = np.maximum(light + dark, np.finfo(float).tiny)
        left = variance - sum(compensable(light, dark, variance))
        quiet = np.median(variance / total) * median_bias(PILOT) <= TARGET and np.mean(left / total) <= UNCOMPENSATED
        return bool(quiet and np.median(total) < self.full_well_e)


def frame_exposure(subject: Subject, series: Series, target: Target, passes: int) -> FrameExposure:
    """For runs of so many passes: the given exposure, if an eighth of them is enough to compensate the noise there."""
    pilot, seen, dark_e = Welford(series.shape), target.scale.seen, mean_dark_e(subject.camera, subject.exposure)
    series.each_pass(0, PILOT, lambda seconds, irradiance, electrons: pilot.add(electrons.copy()))
    noise = pilot.variance_of_mean / np.maximum(target.electrons + dark_e, np.finfo(float).tiny)
    noisiest = seen & (noise > np.quantile(noise[seen], 1 - NOISIEST))
    shown = seen & ~noisiest
    variance_e2 = PILOT * pilot.variance_of_mean[shown]
    one = OnePass(target.electrons[shown], dark_e, variance_e2, subject.camera.pixel.full_well_e)
    share, count = 1.0, max(passes / COMPENSATED, FEWEST_COMPENSATED)
    while not one.compensable(share, count) and share > DIMMEST:
        share *= DIMMER
    while count > FEWEST_COMPENSATED and one.compensable(share, count / 2):
        count /= 2
    dimmed = Exposure(share * subject.exposure.time_s, subject.exposure.temperature_k)
    light = replace(target.photons, mean=share * target.photons.mean)
    variance = expected_moments(chain(subject.camera), light, dimmed)[1][shown]
    pixels = float(variance.sum() ** 2 / (variance**2).sum())
    return FrameExposure(dimmed, share, count, noisiest, float(variance.mean()), pixels)
