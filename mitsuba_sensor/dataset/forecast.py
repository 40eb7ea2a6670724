"""What a dataset will take, from a short render of one scene on this machine: seconds, bytes, render noise."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from ..core import InputError
from ..render.variants import restores_variant
from .checks import Counts
from .make import Rendered, contents_of, is_timed
from .plan import DatasetPlan, Task

RATIO_EXPONENT = 0.75  # of samples, by which the noise ratio of denoised light falls

SHORT_SPP = 32
START_S = 5.0
"""Until the processes of a run have loaded Mitsuba and compiled their first scene."""


@dataclass(frozen=True)
class Forecast:
    """What a dataset will take.

    scene : of which a short render was made.  render_s, sample_s : seconds of a render and of a sample.
    sample_bytes : of its files.  noise_ratio : render variance over sensor variance of the whole render, in the median
    pixel.  seconds, bytes : of everything, if all scenes are like this one.
    """

    scene: str
    render_s: float
    sample_s: float
    sample_bytes: int
    noise_ratio: float
    seconds: float
    bytes: int


@restores_variant
def forecast(plan: DatasetPlan, counts: Counts) -> Forecast:
    """Measure a short render of the first light of the dataset. Raises InputError."""
    task = next(plan.tasks())
    try:
        return _measured(task, counts)
    except InputError as error:
        raise InputError(f"scene {task.scene!r} of the dataset: {error}") from None


def _measured(task: Task, counts: Counts) -> Forecast:
    """Of a short render, or of a whole one where the time of exposure decides it, and of its first sample."""
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
        noise_ratio *= (statistics.samples_per_pixel / spp) ** RATIO_EXPONENT
    light_bytes = 0
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if task.outputs:
            files = contents_of(folder, rendered.files_of_light(folder))
            light_bytes = sum(map(len, files.values()))
        for sample in (task.samples[0], task.samples[-1]):  # the first one compiles
            started = time.monotonic()
            files = contents_of(folder, rendered.files_of(sample, folder))
            sample_s = time.monotonic() - started
    sample_bytes = sum(map(len, files.values()))
    seconds = START_S + counts.tasks * render_s + counts.samples * sample_s
    size = counts.tasks * light_bytes + counts.samples * sample_bytes
    return Forecast(task.scene, render_s, sample_s, sample_bytes, noise_ratio, seconds, size)
