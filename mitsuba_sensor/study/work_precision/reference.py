"""The references: the same scene with many more samples, and the standard error that they still have.

Irradiance is compared with bands that are exact each for itself ("cube"), electrons with bands whose sum is exact
("auto"), channels with channels: bands of finite width have an error of their own, which is told apart.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.frame import Frame
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...render.stop_criterion import StopCriterion
from ...sensor.chain import chain
from ...sensor.effects.dark_current import mean_dark_e
from ..frames import expected_moments
from ..statistics import Array
from ..subject import Subject
from .series import Layers, Series, Setting, loaded

REFERENCE_S = 15.0  # seconds that each reference may take, as its first passes tell
FEWEST_PASSES = 8  # of a reference: its variance is the spread of its passes, averaged over all pixels
SAMPLES, SAMPLES_OF_FOUR = 256, 64
"""Per pass, of all bands together and of four at a time: large passes have less noise (benchmarks/render_passes.py)."""
SEED = 0  # of the references; runs have 1, 2, …
DARKEST = 0.1
"""Of the mean: errors of darker pixels are relative to this level, or a few pixels in the dark would be all of it."""
STEP = 0.01  # relative step of the light by which the slope of the digital numbers is found


@dataclass(frozen=True, eq=False)
class Scale:
    """What errors are relative to, and where.

    seen : pixels with light and below full well, (H, W).  level : light of a pixel over their mean, (H, W); darker ones
    count as DARKEST.  mean_e : of their electrons.  bands : (B,) means of their irradiance.
    """

    seen: NDArray[np.bool_]
    level: Array
    mean_e: float
    bands: Array

    def mean_square(self, measure: str, off: Array) -> float:
        """Mean of a squared error: of "electrons" (H, W), each relative to its pixel's light; of "irradiance"
        (H, W, B), to its pixel's light and its band's; of "dn" (H, W) [DN²]."""
        level = self.level[self.seen]
        if measure == "dn":
            return float(np.mean(off[self.seen] ** 2))
        if measure == "electrons":
            return float(np.mean((off[self.seen] / (self.mean_e * level)) ** 2))
        lit = self.bands > 0
        return float(np.mean((off[self.seen][:, lit] / (level[:, None] * self.bands[lit])) ** 2))


@dataclass(frozen=True, eq=False)
class Reference:
    """A render with many samples. irradiance : (H, W, B) [W m⁻² nm⁻¹].  electrons, variance_e2 : (H, W).

    squares : squared standard errors of irradiance, electrons and digital numbers, on the scale of the errors that they
    are taken off.
    """

    passes: int
    samples_per_pixel: int
    seconds: float
    squares: Mapping[str, float]
    layers: Layers
    irradiance: Array
    electrons: Array
    variance_e2: Array

    @property
    def photons(self) -> Photons:
        """The light, for :func:`mitsuba_sensor.expose`."""
        return self.layers.light(self.irradiance, self.electrons)

    def difference(self, other: Reference) -> tuple[float, float]:
        """Relative difference of the mean electrons from another's, and its standard error."""
        mean = float(other.electrons.mean())
        variance = float(self.variance_e2.sum() + other.variance_e2.sum()) / other.electrons.size**2
        return (float(self.electrons.mean()) - mean) / mean, math.sqrt(variance) / mean


class Target:
    """What a setting is compared with.

    electrons, irradiance : as in :class:`Reference`, which may be two.  photons : the light of the electrons.
    mean_dn : (H, W).  scale : what errors are relative to.  squares : of the references' own errors, by measure.
    """

    def __init__(self, subject: Subject, references: Mapping[str, Reference], banding: str) -> None:
        own = "channels" if banding == "channels" else "auto"
        source = references[own]
        bands = source if own == "channels" else references.get("cube", source)
        self.electrons, self.irradiance, self.photons = source.electrons, bands.irradiance, source.photons
        self.mean_dn = expected_moments(chain(subject.camera), self.photons, subject.exposure)[0]
        self.scale = scale_of(subject, source.electrons, source.irradiance)
        self.squares = {**source.squares, "irradiance": bands.squares["irradiance"]}


def scale_of(subject: Subject, electrons: Array, irradiance: Array) -> Scale:
    """The scale of this light; where all of it is above full well, of all."""
    dark = mean_dark_e(subject.camera, subject.exposure)
    seen = (electrons > 0) & (electrons + dark < subject.camera.pixel.full_well_e)
    seen = seen if seen.any() else electrons > 0
    mean_e = float(electrons[seen].mean())
    return Scale(seen, np.maximum(electrons / mean_e, DARKEST), mean_e, irradiance[seen].mean(axis=0))


def render_reference(subject: Subject, setting: Setting, scale: Scale | None = None) -> Reference:
    """Render one. scale : what errors are relative to; by default as this reference itself has it."""
    grouped = setting.banding == "cube"
    series = loaded(subject, replace(setting, samples=SAMPLES_OF_FOUR if grouped else SAMPLES))
    passes, seconds = _rendered(series, grouped)
    renderer = series.job.renderer
    irradiance = np.concatenate([strip.bands.mean for strip in renderer.strips])
    variance = np.concatenate([strip.bands.variance_of_mean for strip in renderer.strips])
    electrons, variance_e2 = renderer.electrons()
    if not electrons.any():
        raise InputError("the scene is black for this camera; give it an emitter with a spectrum in the camera's band.")
    scale = scale or scale_of(subject, electrons, irradiance)
    slope = _dn_per_electron(subject, series.layers.light(irradiance, electrons), electrons)
    errors = {"irradiance": np.sqrt(variance), "electrons": np.sqrt(variance_e2), "dn": slope * np.sqrt(variance_e2)}
    squares = {measure: scale.mean_square(measure, error) for measure, error in errors.items()}
    arrays = irradiance.astype(np.float32).astype(np.float64), electrons, variance_e2
    return Reference(passes, renderer.samples_per_pixel, seconds, squares, series.layers, *arrays)


def _rendered(series: Series, grouped: bool) -> tuple[int, float]:
    """Passes that were rendered within the time, and what they took."""

    def timed(passes: int) -> float:
        began = time.perf_counter()
        criterion = StopCriterion(passes, series.samples, grouped=grouped)
        series.job.renderer.run(SEED, criterion, lambda step: None)
        return time.perf_counter() - began

    timed(1)  # compiles
    passes = max(math.ceil(REFERENCE_S / timed(1)), FEWEST_PASSES)
    return passes, timed(passes)


def electrons_of(photons: Photons, subject: Subject) -> Array:
    """Mean photoelectrons that every pixel detects, (H, W)."""
    shape = photons.mean.shape[0], photons.mean.shape[1]
    frame = Frame(subject.exposure, SensorWindow(0, shape, photons.origin))
    return np.asarray(chain(subject.camera)[0].sample(photons, frame).light)


def _dn_per_electron(subject: Subject, photons: Photons, electrons: Array) -> Array:
    """Slope of the mean digital number, (H, W); 0 in the dark and where it is clipped."""
    lights = [replace(photons, mean=photons.mean * (1 + step)) for step in (STEP, -STEP)]
    more, less = (expected_moments(chain(subject.camera), light, subject.exposure)[0] for light in lights)
    return np.asarray((more - less) / (2 * STEP * np.maximum(electrons, np.finfo(float).tiny)) * (electrons > 0))
