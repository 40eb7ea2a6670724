"""Frames that each have a render of their own, and may spend its noise as part of their shot noise."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.checks import first_given
from ..core.errors import InputError, require_seed
from ..core.exposure import Exposure
from ..core.signals import Photons
from ..sensor.checks import check_numbers
from ..sensor.compensation import LIMIT, compensable
from ..sensor.effects.dark_current import mean_dark_e
from ..sensor.expose import Frames, expose
from .irradiance import Irradiance, Job, RenderOptions, prepare
from .passes import FEWEST, hashed_seed, whole_grid
from .photons import collect
from .renderer import Criterion, Map
from .statistics import median_bias
from .stop_criterion import Step, StopCriterion

if TYPE_CHECKING:
    from ..sensor.camera import Camera

RenderNoiseMode = Literal["compensated", "per-frame"]
RENDER_NOISE_MODES = ("compensated", "per-frame")
EXPOSING = ("maps", "chain", "engine", "precision", "keep", "plan")
AIM = LIMIT / 2  # median of v/μ: below it the total has the shape of Poisson's law (sensor/compensation.py)
FEWEST_JUDGED = 7  # degrees of freedom of a measured variance; with fewer passes more than 1 % stays uncompensated
UNCOMPENSATED = 0.015  # of the shot variance, averaged over all but the noisiest pixels: what may stay as excess noise
NOISIEST = 0.01  # of the pixels, e.g. edges of a lamp: they alone would ask for two to three times the samples
MARGIN = 1.15  # on the samples that a frame needs: what is left differs from frame to frame by a tenth or so


@dataclass(frozen=True, eq=False)
class FrameOfRender:
    """One frame, and the render that it was made from.

    uncompensated : what is left of the render's variance over the shot variance, averaged over the pixels: the frame is
        that much too noisy; without compensation, all of it.
    """

    frames: Frames
    light: Irradiance
    photons: Photons
    uncompensated: float


def render_frames(
    scene: str | os.PathLike[str],
    camera: Camera | None = None,
    exposure: Exposure | None = None,
    *,
    frames: int = 1,
    first_frame: int = 0,
    seed: int | None = None,
    serial: int | None = None,
    render_noise: RenderNoiseMode = "compensated",
    exposing: Mapping[str, Any] | None = None,
    progress: Callable[[int, Step], None] | None = None,
    **rendering: Any,
) -> Iterator[FrameOfRender]:
    """Frames of a scene, each from a render with a seed of its own; one at a time, all checked before the first.

    render_noise : "compensated" counts the render's noise as part of the shot noise, so that 16 times fewer samples are
        enough than for a noise ratio of 0.01; "per-frame" adds it to the shot noise.
    exposing : other words of :func:`expose`: maps, chain, engine, precision, keep, plan.
    progress : called with the frame's number and a :class:`render.stop_criterion.Step` of its render.
    rendering : other options of :func:`render`. By default "compensated" renders until the median of v/μ, the variance
        of the render over that of the shot noise, is 1/6, and at most 1.5 % is left uncompensated outside the noisiest
        1 % of the pixels;
        "spectral" is "channels", since each render is used once. The first frame tells how large the passes of the
        others are: give ``spp`` where a frame must come out the same when it is made alone.
    Raises InputError.
    """
    if render_noise not in RENDER_NOISE_MODES:
        raise InputError(f"render_noise is {render_noise!r}; it must be one of {', '.join(RENDER_NOISE_MODES)}.")
    words = dict(exposing or {})
    if unknown := sorted(set(words) - set(EXPOSING)):
        raise InputError(f"exposing names {unknown[0]!r}; it may have {', '.join(EXPOSING)}.")
    if rendering.get("denoise"):
        raise InputError("denoise and shoot do not go together: what a denoiser leaves of the noise cannot be spent.")
    options = RenderOptions(**rendering)
    aims = render_noise == "compensated" and options.spp is None and options.noise_ratio is None
    wanted = replace(options, noise_ratio=1.0) if aims else options
    wanted.budget()  # refuses before anything is loaded
    check_numbers(frames, first_frame, 1 if seed is None else seed)
    job = prepare(scene, camera, exposure, options, usual="channels")
    _refuse_uncompensable(render_noise, job.camera, words)
    budget = wanted.budget(len(job.bands.groups))
    if aims:
        budget = replace(budget, reached="compensable")
    seeds = job.seed(seed), require_seed("serial", first_given(serial, job.setup.serial, 1))
    measure = _yardstick(job) if aims else None
    tell = progress or (lambda frame, step: None)
    numbers = range(first_frame, first_frame + frames)
    return _takes(job, budget, measure, numbers, seeds, render_noise == "compensated", words, tell)


def _refuse_uncompensable(render_noise: str, camera: Camera, exposing: dict[str, Any]) -> None:
    """What :func:`expose` would refuse after the first render."""
    if render_noise != "compensated":
        return
    if exposing.get("chain", "physical") != "physical":
        raise InputError(
            f"render_noise is 'compensated' and chain {exposing['chain']!r}; that needs the physical chain."
        )
    if camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"render_noise is 'compensated' and {camera.name} has a quantum_yield, whose electrons come in bursts; "
            "take render_noise 'per-frame'."
        )


def _takes(
    job: Job, budget: StopCriterion, measure: Criterion | None, numbers: range, seeds: tuple[int, int], spend: bool,
    exposing: dict[str, Any], tell: Callable[[int, Step], None],
) -> Iterator[FrameOfRender]:  # fmt: skip
    for number in numbers:
        seed = hashed_seed(seeds[0], -1, number)

        def step(now: Step, number: int = number) -> None:
            tell(number, now)

        light = job.irradiance(seed, budget, step, time.monotonic(), measure)
        if not budget.sized or (measure is not None and number == numbers[0]):  # the first render tells it for all
            size = job.renderer.samples if measure is None else _size(job, measure)
            budget = replace(budget, passes=max(budget.passes * budget.samples // size, 2), samples=size, sized=True)
        photons = collect(light, job.camera, job.exposure)
        mean, variance = job.renderer.electrons()
        if spend:
            photons = replace(photons, variance_e2=np.where(np.isfinite(photons.total), variance, 0.0))
        made = expose(photons, job.camera, job.exposure, seed=seeds[0], serial=seeds[1], first_frame=number, **exposing)
        yield FrameOfRender(made, light, photons, uncompensated(job, mean, variance, spend))


def _size(job: Job, measure: Criterion) -> int:
    """Samples per pass with which the fewest passes are just enough; a variance falls as one over the samples."""
    renderer = job.renderer
    needed = renderer.passes * renderer.samples * measure(*renderer.noise_estimate())
    return min(whole_grid(max(MARGIN * needed / FEWEST, 1.0)), renderer.samples)


def uncompensated(job: Job, mean_e: Map, variance_e2: Map, spend: bool = True) -> float:
    """What is left of the render's variance over the shot variance of light and dark, averaged over the pixels."""
    return float(_left(job, mean_e, variance_e2, spend).mean())


def _left(job: Job, mean_e: Map, variance_e2: Map, spend: bool = True) -> NDArray[np.float64]:
    """The same of every pixel that has any light and stays below the full well, (N,)."""
    dark = mean_dark_e(job.camera, job.exposure)
    total = mean_e + dark
    shown = (total > 0) & (total < job.camera.pixel.full_well_e)
    if not shown.any():
        return np.zeros(1)
    spent = sum(compensable(mean_e, dark, variance_e2)) if spend else 0.0
    return np.asarray((variance_e2 - spent)[shown] / total[shown])


def _yardstick(job: Job) -> Criterion:
    """1 where a render is good enough to be spent: by the median of v/μ, and by what is left uncompensated."""
    dark = mean_dark_e(job.camera, job.exposure)

    def measure(mean_e: Map, variance_e2: Map, freedom: int) -> float:
        ratio = variance_e2 / np.maximum(mean_e + dark, np.finfo(float).tiny)
        median = float(np.median(ratio)) * median_bias(freedom + 1)
        if freedom < FEWEST_JUDGED:  # a mean over pixels hangs on the few whose variance is not known yet
            return median / AIM
        left = _left(job, mean_e, variance_e2)
        return max(median / AIM, float(left[left <= np.quantile(left, 1 - NOISIEST)].mean()) / UNCOMPENSATED)

    return measure
