"""Renders for frames that each have one of their own, whose noise may be part of the shot noise (compensated)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import InputError, Photons, first_given
from ...core.options import part_of
from ...sensor.checks import check_numbers
from ...sensor.expose import PreparedExposure
from ...sensor.frame_times import FrameTimes
from ...sensor.metering import AskedExposure
from ...sensor.options import ExposeOptions
from ...stages.effects.dark_current import mean_dark_e
from ...stages.effects.shot_noise import LIMIT, compensable, largest_e2
from ..light.irradiance import Irradiance
from ..light.light_source import CollectedLight
from ..light.photons import photons_of
from ..options import FrameSeriesOptions, RenderOptions
from ..scene.scene_nodes import SceneInput
from ..scene.scene_settings import ParsedScene
from ..variants import mitsuba
from .noisy_pixels import NoisyPixels, fewest_samples
from .passes import hashed_seed, whole_grid
from .prepared import PreparedRender, prepare
from .renderer import Criterion, Map, Renderer
from .statistics import median_bias
from .stop_criterion import (
    DEFAULT_SPP,
    FEWEST_TO_STOP,
    Progress,
    RenderProgress,
    StopCriterion,
    check_options,
    stop_criterion_of,
)

PerFrameNoise = Literal["compensated", "per-frame"]
TARGET = (
    LIMIT / 2
)  # median of v/μ: below it the total has the shape of a Poisson law (stages/effects/shot_noise.py)
FEWEST_FREEDOM = 7  # degrees of freedom of a measured variance; with fewer passes more than 1 % stays uncompensated
UNCOMPENSATED = 0.01  # of the shot variance, averaged over all but the noisiest pixels: what may stay as excess noise
NOISIEST = 0.01  # of the pixels, e.g. edges of a lamp: they alone would ask for two to three times the samples
MARGIN = 1.15  # on the samples that a frame needs: what is left differs from frame to frame by a tenth or so
PIXEL_TARGET = (
    0.3  # v/μ of a single pixel, as the render before the first frame has measured it
)
OF_LARGEST = 0.8  # of the variance that can be compensated at all, below one electron


@dataclass(frozen=True, eq=False)
class RenderOfFrame:
    """The render of one frame, and the exposure that the frame is computed from.

    uncompensated : what is left of the render's variance over the shot variance, averaged over the pixels: the frame is
        that much too noisy; without compensation, all of it.
    above_shot_noise : share of the pixels whose render has more variance than their shot noise: only more samples help.
    """

    exposed: PreparedExposure
    light: Irradiance
    photons: Photons
    uncompensated: float
    above_shot_noise: float


@dataclass(frozen=True, eq=False)
class FrameSeries:
    """A loaded scene that is rendered anew for every frame.

    sensor : the exposure of one frame.  stop : of each render.  count : how many frames.
    criterion : 1 where a render can be compensated; None for other stop criteria.
    """

    prepared: PreparedRender
    sensor: PreparedExposure
    stop: StopCriterion
    criterion: Criterion | None
    compensated: bool
    count: int

    @classmethod
    def prepare(
        cls,
        scene: SceneInput | ParsedScene,
        camera: Camera | None,
        exposure: AskedExposure | None,
        options: FrameSeriesOptions,
        render_noise: PerFrameNoise,
    ) -> FrameSeries:
        """Check everything that was asked for, and load the scene. Raises InputError."""
        if render_noise not in (modes := get_args(PerFrameNoise)):
            raise InputError(
                f"render_noise is {render_noise!r}; it must be one of {', '.join(modes)}."
            )
        if options["denoise"]:
            why = "what a denoiser leaves of the noise cannot be compensated; leave one of them out"
            raise InputError(f"denoise and a render for every frame exclude each other: {why}.")
        if FrameTimes.of(options).period_s is not None:
            raise InputError(
                f"render_noise is {render_noise!r}, whose renders are all of one instant; leave fps out."
            )
        compensated = render_noise == "compensated"
        measured = compensated and options["spp"] is None and options["noise_ratio"] is None
        rendering: RenderOptions = {**part_of(RenderOptions, options), "denoise": False}
        wanted: RenderOptions = {**rendering, "noise_ratio": 1.0} if measured else rendering
        if not any(
            wanted[name] is not None
            for name in ("spp", "noise_ratio", "max_spp", "max_seconds")
        ):
            wanted["spp"] = DEFAULT_SPP  # all frames have as many
        check_options(wanted)
        check_numbers(
            options["frames"], options["first_frame"], first_given(options["seed"], 1)
        )
        prepared = prepare(scene, camera, exposure, usual="channels", **rendering)
        if compensated and prepared.camera.readouts:
            end = "has several read-outs of its shot noise; take render_noise 'per-frame'"
            raise InputError(f"render_noise is 'compensated' and {prepared.camera.name} {end}.")
        if compensated and prepared.camera.quantum_efficiency.quantum_yield:
            end = "has a quantum_yield, whose electrons come in bursts; take render_noise 'per-frame'"
            raise InputError(f"render_noise is 'compensated' and {prepared.camera.name} {end}.")
        if prepared.camera.sensor.dual_pixel:
            end = "has dual pixels, whose halves of the pupil are rendered once; leave render_noise out"
            raise InputError(
                f"render_noise is {render_noise!r} and {prepared.camera.name} {end}."
            )
        prepared = prepared.metered_first()
        sensor = prepared.sensor({**part_of(ExposeOptions, options), "frames": 1})
        stop = stop_criterion_of(wanted, len(prepared.bands.groups))
        stop, criterion = (
            (replace(stop, reached="compensable"), _criterion(prepared))
            if measured
            else (stop, None)
        )
        return cls(prepared, sensor, stop, criterion, compensated, options["frames"])

    def renders(self, progress: Progress | None = None) -> Iterator[RenderOfFrame]:
        """One render after the other, each with the exposure of its frame."""
        sensor, first = self.sensor, self.sensor.first.index

        def step(now: RenderProgress, number: int = first) -> None:
            if progress is not None:
                progress(replace(now, frame=number))

        prepared, stop = (
            (self.prepared, self.stop) if self.criterion is None else self._planned(step)
        )
        for number in range(first, first + self.count):
            seed = hashed_seed(sensor.first.seed, -1, number)
            light = prepared.render(
                seed, stop, partial(step, number=number), criterion=self.criterion
            )
            if not stop.sized:  # the first render sizes all others
                samples = prepared.renderer.samples
                stop = replace(
                    stop,
                    passes=max(stop.passes * stop.samples // samples, 2),
                    samples=samples,
                    sized=True,
                )
            photons = photons_of(light, prepared.camera, prepared.exposure)
            photons = photons.changed(source=CollectedLight.of(light, per_frame=True))
            mean, variance = prepared.renderer.electrons()
            if self.compensated:
                photons = photons.changed(
                    variance_e2=np.where(np.isfinite(photons.total), variance, 0.0)
                )
            exposed = sensor.of(photons, number)
            left = _uncompensated(prepared, mean, variance, self.compensated)
            above = _uncompensated(prepared, mean, variance, compensate=False) > 1
            yield RenderOfFrame(
                exposed, light, photons, float(left.mean()), float(above.mean())
            )

    def _planned(self, progress: Progress) -> tuple[PreparedRender, StopCriterion]:
        """The samples of every frame and of its noisiest pixels, by a render before the first frame: its variance falls
        as one over the samples."""
        prepared, stop, criterion = self.prepared, self.stop, self.criterion
        assert criterion is not None
        prepared.render(
            hashed_seed(self.sensor.first.seed, -2, 0), stop, progress, criterion=criterion
        )
        renderer = prepared.renderer
        mean, variance, freedom = renderer.noise_estimate()
        done = renderer.passes * renderer.samples * MARGIN
        samples, times = done * criterion(mean, variance, freedom), None
        ratio, shown = _over_shot(prepared, mean, variance)
        scalar = (
            mitsuba().variant().startswith("scalar")
        )  # a sensor in Python takes 0.1 ms per ray there
        if shown.any() and not scalar:
            median = float(np.median(ratio[shown])) * median_bias(freedom + 1)
            needed = np.where(shown, done * ratio / _pixel_targets(prepared, mean), 0.0)
            samples, times = fewest_samples(needed, max(done * median / TARGET, 1.0))
        if times is not None and times.any():
            scene = prepared.scene.with_noisy(NoisyPixels(times, prepared.bands.responses))
            renderer = Renderer(scene, prepared.camera, prepared.exposure, prepared.bands)
            prepared = replace(prepared, scene=scene, renderer=renderer)
        most = stop.passes * stop.samples
        each = whole_grid(max(min(samples, most) / FEWEST_TO_STOP, 1.0), stop.repeatable)
        return prepared, replace(stop, passes=max(most // each, 2), samples=each, sized=True)


def _over_shot(
    prepared: PreparedRender, mean_e: Map, variance_e2: Map
) -> tuple[Map, NDArray[np.bool_]]:
    """The render's variance over the shot variance of light and dark, and which pixels have any light and stay below
    the full well, (H, W) each."""
    total = mean_e + mean_dark_e(prepared.camera, prepared.exposure)
    shown = (total > 0) & (total < prepared.camera.pixel.full_well_e)
    return variance_e2 / np.where(shown, total, np.inf), shown


def _pixel_targets(prepared: PreparedRender, mean_e: Map) -> Map:
    """v/μ of every pixel that its shot noise can give way to, with some margin, (H, W)."""
    dark = mean_dark_e(prepared.camera, prepared.exposure)
    largest = largest_e2(np.maximum(mean_e, dark)) / np.maximum(
        mean_e + dark, np.finfo(float).tiny
    )
    return np.asarray(np.clip(OF_LARGEST * largest, np.finfo(float).tiny, PIXEL_TARGET))


def _uncompensated(
    prepared: PreparedRender, mean_e: Map, variance_e2: Map, compensate: bool = True
) -> Map:
    """What is left of the render's variance over the shot variance of light and dark, (N,): of every pixel that has any
    light and stays below the full well."""
    dark = mean_dark_e(prepared.camera, prepared.exposure)
    compensated: Any = sum(compensable(mean_e, dark, variance_e2)) if compensate else 0.0
    ratio, shown = _over_shot(prepared, mean_e, variance_e2 - compensated)
    return ratio[shown] if shown.any() else np.zeros(1)


def _criterion(prepared: PreparedRender) -> Criterion:
    """1 where a render's noise can be compensated: by the median of v/μ, and by what is left uncompensated."""
    dark = mean_dark_e(prepared.camera, prepared.exposure)

    def measure(mean_e: Map, variance_e2: Map, freedom: int) -> float:
        ratio = variance_e2 / np.maximum(mean_e + dark, np.finfo(float).tiny)
        median = float(np.median(ratio)) * median_bias(freedom + 1)
        if (
            freedom < FEWEST_FREEDOM
        ):  # a mean over pixels hangs on the few whose variance is not known yet
            return median / TARGET
        left = _uncompensated(prepared, mean_e, variance_e2)
        return max(
            median / TARGET,
            float(left[left <= np.quantile(left, 1 - NOISIEST)].mean()) / UNCOMPENSATED,
        )

    return measure
