"""Estimate what a dataset takes, from short renders of one view on this machine: seconds, bytes, render noise."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

from ..core import InputError
from ..files import durable
from ..files.user_cache import cache_folder
from ..render.variants import restores_variant
from .checks import Counts
from .make import Rendered, contents_of, is_timed
from .plan import DatasetPlan, Task

DENOISED_EXPONENT = 0.75
"""The noise ratio of denoised light falls with this power of the samples."""
SHORT_SPP = 32
START_S = 5.0
"""Until the processes of a run have loaded Mitsuba and compiled their first scene."""


@dataclass(frozen=True)
class Forecast:
    """Estimate for a dataset.

    scene : that was rendered.  render_s, sample_s : seconds of a render and of a sample, means over the cameras.
    sample_bytes : of the files of a sample.  noise_ratios : by camera, render variance over temporal variance of the
    sensor after a whole render, in the median pixel.  noise_ratio : the largest of them.
    seconds, bytes : of the whole dataset, if all scenes are like this one.
    """

    scene: str
    render_s: float
    sample_s: float
    sample_bytes: int
    noise_ratio: float
    noise_ratios: dict[str, float]
    seconds: float
    bytes: int


@restores_variant
def forecast(plan: DatasetPlan, counts: Counts) -> Forecast:
    """Measure a short render of the first light of each camera. Raises InputError.

    Files are in a scratch folder of the user's cache, which is removed at the end.
    """
    firsts: dict[str, Task] = {}
    for task in plan.tasks():
        for sample in task.samples:
            firsts.setdefault(sample.values["camera"], task)
        if len(firsts) == len(plan.file.cameras):
            break
    try:
        scratch = cache_folder()
    except RuntimeError:
        raise InputError(
            "the user has no home folder for a short render; set XDG_CACHE_HOME, or count without a render."
        ) from None
    durable.remove_unfinished(scratch)
    measured: dict[str, tuple[float, ...]] = {}
    with durable.scratch_folder(scratch) as folder:
        for task in firsts.values():
            try:
                measured[task.key] = measured.get(task.key) or _measured(task, folder)
            except InputError as error:
                raise InputError(f"scene {task.scene!r} of the dataset: {error}") from None
    render_s, sample_s, light_bytes, sample_bytes, _ = map(
        fmean, zip(*measured.values(), strict=True)
    )
    ratios = {camera: measured[task.key][-1] for camera, task in firsts.items()}
    return Forecast(
        scene=next(iter(firsts.values())).scene,
        render_s=render_s,
        sample_s=sample_s,
        sample_bytes=round(sample_bytes),
        noise_ratio=max(ratios.values()),
        noise_ratios=ratios,
        seconds=START_S + counts.tasks * render_s + counts.samples * sample_s,
        bytes=round(counts.tasks * light_bytes + counts.samples * sample_bytes),
    )


def _measured(task: Task, folder: Path) -> tuple[float, ...]:
    """Measure a short render, or a whole one if the exposure time decides it, and one of its samples.

    Returns seconds of the render and of the sample, bytes of the light and of the sample, and the noise ratio.
    """
    spp = task.config["render"]["spp"]
    is_whole = not spp or is_timed(task)
    if not is_whole:
        render = {**task.config["render"], "spp": min(spp, SHORT_SPP)}
        task = replace(task, config={**task.config, "render": render})
        Rendered(task)  # compiles
    started = time.monotonic()
    rendered = Rendered(task)
    render_s, statistics = time.monotonic() - started, rendered.light.statistics
    noise_ratio = statistics.noise_ratio_median
    if not is_whole:
        render_s += rendered.seconds_per_sample * (spp - statistics.samples_per_pixel)
        exponent = DENOISED_EXPONENT if task.config["render"]["denoise"] else 1.0
        noise_ratio *= (statistics.samples_per_pixel / spp) ** exponent
    light_files = rendered.files_of_light(folder) if task.outputs else {}
    light_bytes = sum(map(len, contents_of(folder, light_files).values()))
    for sample in (task.samples[0], task.samples[-1]):  # the first one compiles
        started = time.monotonic()
        files = contents_of(folder, rendered.files_of(sample, folder))
        sample_s = time.monotonic() - started
    return render_s, sample_s, light_bytes, sum(map(len, files.values())), noise_ratio
