"""Errors of a render in irradiance, electrons, mean and temporal σ of the digital numbers, against long references.

Irradiance is compared with bands that are exact each for itself ("cube"), electrons with bands whose sum is exact
("auto"), channels with channels. A run of passes is cut into all its blocks of 1, 2, 4, …, each a render of its own;
all of one size are averaged, so that a rare bright path counts alike in every size.
"""

from __future__ import annotations

import math
import statistics
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Exposure, Frame, Photons, SensorWindow
from ...expose import expose
from ...render.denoise.denoise import LEAST_PASSES
from ...render.light.irradiance import Irradiance
from ...render.passes.passes import Welford
from ...render.passes.per_frame import NOISIEST, TARGET, UNCOMPENSATED
from ...render.passes.statistics import median_bias
from ...render.passes.stop_criterion import StopCriterion
from ...sensor.compensation import compensable
from ...sensor.effects.dark_current import mean_dark_e
from ..frames import expected_moments
from ..kit import Array, Subject
from .settings import Block, RenderSetting, Series, in_blocks

REFERENCE_S = 15.0  # seconds that each reference may take, as its first passes tell
STEP, PILOT = 0.01, 8  # relative, of the light, for the slope of the DN; passes whose spread tells how noisy one is
FEWEST_COMPENSATED = (
    8  # passes from which a variance can be compensated: 7 degrees of freedom (render/passes/per_frame.py)
)
TINY = float(np.finfo(float).tiny)
PLAIN, COMPENSATED, DENOISED = "plain", "compensated", "denoised"  # what is done about the render's noise

Rung = dict[str, float]  # of all blocks of a size: "passes", "blocks", "seconds", squared errors, "variance_dn2"


class Reference(NamedTuple):
    """A render with many samples, its photons for :func:`mitsuba_sensor.expose`, and its electrons (H, W)."""

    light: Irradiance
    photons: Photons
    electrons: Array
    variance_e2: Array


class Target:
    """What a setting is compared with, and the scale of its errors; bands, own : of the irradiance and of all else."""

    def __init__(self, subject: Subject, references: Mapping[str, Reference], banding: str) -> None:
        self.subject, self.own = subject, references["channels" if banding == "channels" else "auto"]
        self.bands = self.own if banding == "channels" else references.get("cube", self.own)
        electrons, dark_e = self.own.electrons, mean_dark_e(subject.camera, subject.exposure)
        lit = (electrons > 0) & np.isfinite(self.own.photons.total)
        seen = lit & (electrons + dark_e < subject.camera.pixel.full_well_e)
        self.seen = seen if seen.any() else lit  # (H, W)
        self._mean_e = float(electrons[self.seen].mean())
        self._mean_of_band = self.own.light.data[self.seen].mean(axis=0, dtype=np.float64)
        self._level = np.maximum(electrons / self._mean_e, 0.1)[self.seen]  # or errors of darker ones would be all
        self.mean_dn = mean_dn(subject, self.own.photons)

    def mean_square(self, measure: str, off: Array) -> float:
        """Mean of a squared error: of "electrons" or "dn" (H, W), of "irradiance" (H, W, B); of "dn" in DN²."""
        off, lit = off[self.seen], self._mean_of_band > 0
        if measure == "electrons":  # relative to the pixel's light
            off = off / (self._mean_e * self._level)
        elif measure == "irradiance":  # and to the band's
            off = off[:, lit] / (self._level[:, None] * self._mean_of_band[lit])
        return float(np.mean(off**2))

    @property
    def squares(self) -> dict[str, float]:
        """Squared standard errors of the references, on the scale of the errors that they are taken off."""
        return {**self.squares_of(self.own), "irradiance": self.squares_of(self.bands)["irradiance"]}

    def squares_of(self, reference: Reference) -> dict[str, float]:
        """Squared standard errors of one reference, by measure."""
        photons, electrons = reference.photons, reference.electrons
        more, less = (mean_dn(self.subject, replace(photons, mean=photons.mean * (1 + x))) for x in (STEP, -STEP))
        error_e, lit = np.sqrt(reference.variance_e2), electrons > 0  # slope 0 in the dark and where clipped
        error_dn = (more - less) / (2 * STEP * np.maximum(electrons, TINY)) * lit * error_e
        errors = {"electrons": error_e, "irradiance": reference.light.standard_error, "dn": error_dn}
        return {measure: self.mean_square(measure, error) for measure, error in errors.items()}


def render_reference(subject: Subject, setting: RenderSetting) -> Reference:
    """Render as many passes as the time allows. Raises InputError for a scene without light."""
    grouped = setting.banding == "cube"
    series = Series(subject, setting._replace(samples=64 if grouped else 256))  # benchmarks/render_passes.py
    render, one = series.job.render, StopCriterion(1, series.setting.samples, grouped=grouped)
    _, second = render(0, one), render(0, one)  # the first compiles; runs have seeds 1, 2, …
    light = render(0, replace(one, passes=max(math.ceil(REFERENCE_S / second.statistics.seconds), 8)))
    electrons, variance_e2 = series.job.renderer.electrons()
    return Reference(light, series.light(light.data.astype(np.float64), electrons), electrons, variance_e2)


def electrons_of(photons: Photons, subject: Subject) -> Array:
    """Mean photoelectrons that every pixel detects, (H, W)."""
    frame = Frame(subject.exposure, SensorWindow(0, photons.total.shape, photons.origin))
    return np.asarray(subject.camera.stages[0].sample(photons, frame).light)


def mean_dn(subject: Subject, photons: Photons) -> Array:
    """Mean digital numbers in theory, (H, W)."""
    return np.asarray(expected_moments(subject.camera.stages, photons, subject.exposure)[0])


class FrameExposure(NamedTuple):
    """The exposure at which frames are made: the given one, or a share at which render noise can be compensated."""

    exposure: Exposure
    share: float
    compensable: float  # passes after which render noise is as low as compensation aims at
    shown: NDArray[np.bool_]  # pixels whose frames are looked at: those that are seen, without the noisiest, (H, W)
    variance_dn2: float  # temporal, that frames must have there on average
    pixels: float  # so many of equal variance would tell it as well


def frame_exposure(series: Series, target: Target, passes: int) -> FrameExposure:
    """For runs of so many passes: the given exposure, if an eighth of them is enough to compensate the noise there."""
    camera, exposure, pilot = target.subject.camera, target.subject.exposure, Welford.of_shape(series.shape)
    for block in series.passes(0, PILOT):
        pilot.add(block.electrons)
    dark_e, one_pass_e2 = mean_dark_e(camera, exposure), PILOT * pilot.variance_of_mean
    noise = one_pass_e2 / np.maximum(target.own.electrons + dark_e, TINY)
    shown = target.seen & (noise <= np.quantile(noise[target.seen], 1 - NOISIEST))

    def enough(share: float, count: float) -> bool:
        """Whether so many passes are quiet enough at a share of the exposure, as render/passes/per_frame.py decides."""
        light, dark = share * target.own.electrons[shown], share * dark_e
        variance = share**2 * one_pass_e2[shown] / count  # electrons go with the exposure, this with its square
        total = np.maximum(light + dark, TINY)
        left = variance - sum(compensable(light, dark, variance))
        quiet = np.median(variance / total) * median_bias(PILOT) <= TARGET and np.mean(left / total) <= UNCOMPENSATED
        return bool(quiet and np.median(total) < camera.pixel.full_well_e)

    share, count = 1.0, max(passes / 8, FEWEST_COMPENSATED)  # noise just compensable
    while not enough(share, count) and share > 2.0**-30:  # where any render is compensable
        share *= 2.0**-0.25
    while count > FEWEST_COMPENSATED and enough(share, count / 2):
        count /= 2
    dimmed = Exposure(share * exposure.time_s, exposure.temperature_k)
    light = replace(target.own.photons, mean=share * target.own.photons.mean)
    variance = expected_moments(camera.stages, light, dimmed)[1][shown]
    pixels = float(variance.sum() ** 2 / (variance**2).sum())
    return FrameExposure(dimmed, share, count, shown, float(variance.mean()), pixels)


class Ladder(NamedTuple):
    """The passes of a setting's runs."""

    samples: int  # per pixel, pass and group of bands
    groups: int
    first_s: float  # loading and compiling
    pass_s: float
    passes: int  # of a run
    framed: FrameExposure | None  # where frames are made


class Run:
    """One run of passes. number : its seed."""

    def __init__(self, series: Series, target: Target, ladder: Ladder, number: int) -> None:
        self._series, self._target, self._ladder, self._number = series, target, ladder, number
        self._found = defaultdict[tuple[str, int], defaultdict[str, list[float]]](lambda: defaultdict(list))
        self._frames = defaultdict[tuple[str, int], Welford](lambda: Welford.of_shape(series.shape))

    def measure(self, smooth: bool) -> dict[str, list[Rung]]:
        """Rungs of every treatment, the shortest first. smooth : whether there are denoised renders too."""
        framed = self._ladder.framed
        for block in in_blocks(self._series.passes(self._number, self._ladder.passes)):
            self._errors(PLAIN, block)
        passes = LEAST_PASSES
        while smooth and passes <= self._ladder.passes:
            self._errors(DENOISED, self._series.denoised(self._number, passes))
            passes *= 2
        rungs = defaultdict[str, list[Rung]](list)
        for (treatment, passes), found in sorted(self._found.items()):
            rung: Rung = {"passes": passes, "blocks": len(found["seconds"])}
            rung |= {name: statistics.fmean(values) for name, values in found.items()}
            if framed is not None and (frames := self._frames[treatment, passes]).count > 1:
                rung["variance_dn2"] = float(frames.variance_of_mean[framed.shown].mean()) * frames.count
            rungs[treatment].append(rung)
        return dict(rungs)

    def _errors(self, treatment: str, block: Block) -> None:
        """What a block is off, and its frames."""
        target, ladder, found = self._target, self._ladder, self._found[treatment, block.passes]
        off = {"electrons": block.electrons - target.own.electrons}
        if self._series.bands.kind != "channels":
            off["irradiance"] = block.irradiance - target.bands.light.data
        if 16 * block.passes >= ladder.passes:  # moments and frames take as long as a pass
            light = self._series.light(block.irradiance, block.electrons)
            off["dn"] = mean_dn(target.subject, light) - target.mean_dn
            if ladder.framed is not None and FEWEST_COMPENSATED <= block.passes < ladder.passes:
                self._expose(ladder.framed, treatment, block, light)
        found["seconds"].append(block.seconds)
        for measure, values in off.items():
            found[measure].append(target.mean_square(measure, values))

    def _expose(self, framed: FrameExposure, treatment: str, block: Block, light: Photons) -> None:
        """A frame of a block; beside a plain one also a compensated one, with the same random bits on one sensor."""
        camera, number = self._target.subject.camera, sum(frames.count for frames in self._frames.values()) + 1
        lights = {treatment: replace(light, mean=framed.share * light.mean)}
        if treatment == PLAIN and not camera.quantum_efficiency.quantum_yield:  # its bursts are not Poisson's
            variance_e2 = np.asarray(block.squares / (block.passes * (block.passes - 1)))  # of the mean electrons
            lights[COMPENSATED] = replace(lights[PLAIN], variance_e2=framed.share**2 * variance_e2)
            self._found[COMPENSATED, block.passes]["seconds"].append(block.seconds)
        for name, one in lights.items():
            digital = expose(one, camera, framed.exposure, seed=self._number, first_frame=number).digital[0]
            self._frames[name, block.passes].add(digital.astype(np.float64))
