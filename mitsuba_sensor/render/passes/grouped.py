"""Render of the light groups of a scene, one after the other with equal samples, and their sum."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...camera.dual_pixels import PHOTODIODES
from ..light.brightness import with_brightness
from ..light.irradiance import Irradiance
from ..light.light_sum import notes_of_groups, sum_of_groups
from ..light.photons import mean_electrons
from ..light.statistics import POOLED, NoiseRatios, RenderStatistics, coarsest, summary_of
from ..lint.refusals import refuse_black
from ..lint.spectrum_checks import with_notes_of_shares
from ..load.half_pupil import half_note
from ..samples import PASSES_MIN, hashed_seed
from .stop_criterion import Progress, RenderProgress, StopCriterion

if TYPE_CHECKING:
    from .prepared import PreparedRender


def render_light_groups(
    whole: PreparedRender,
    seed: int,
    stop: StopCriterion,
    progress: Progress | None,
    began: float,
) -> Irradiance:
    """Return the sum of all light groups, which contains the groups.  began : start on the monotonic clock [s]."""
    lights, part = dict[str, Irradiance](), stop.shared(len(whole.light_groups))

    def tell(name: str, step: RenderProgress) -> None:
        if progress is not None:
            progress(replace(step, light_group=name, seconds=time.monotonic() - began))

    for group in whole.light_groups:
        name = group.name
        # Each group has a different seed, so the noise of two groups is independent.
        group_seed = hashed_seed(seed, 0, int.from_bytes(name.encode(), "little"))
        render = whole.of_light_group(group)
        lights[name] = render.render(group_seed, part, partial(tell, name))
    total = sum_of_groups(lights)
    if not total.data.any():
        refuse_black(whole.bands.ends_nm, total.statistics.non_finite, whole.at_rest.findings)
    statistics = _statistics(whole, total, lights, stop, time.monotonic() - began)
    light = replace(total, statistics=statistics)
    light = with_notes_of_shares(light, whole.camera, whole.at_rest.findings)
    return with_brightness(light, whole)


def _statistics(
    whole: PreparedRender,
    total: Irradiance,
    lights: Mapping[str, Irradiance],
    stop: StopCriterion,
    seconds: float,
) -> RenderStatistics:
    """Return the statistics of the sum: samples and seconds of all groups, noise of their sum."""
    parts = [light.statistics for light in lights.values()]
    samples = sum(part.samples_per_pixel for part in parts)
    passes = min(part.passes for part in parts)
    sample_s = sum(part.seconds_per_sample * part.samples_per_pixel for part in parts)
    mean_e = mean_electrons(total, whole.camera, whole.exposure)
    lit = (mean_e > 0) & np.isfinite(mean_e)

    def ratios(relative: NDArray[np.float32] | None, count: int) -> NoiseRatios:
        assert relative is not None
        light = np.where(lit, mean_e, 0.0), np.where(lit, relative * mean_e, 0.0) ** 2
        return summary_of(whole.noise_ratio(whole.exposure, light), lit, count)

    before = ratios(total.pass_error, passes)
    records = [part.denoised for part in parts if part.denoised is not None]
    denoised = None
    if records:
        denoised = {
            **records[0],
            "raw_weight": float(np.mean([record["raw_weight"] for record in records])),
            "sum_corrected_by": max(record["sum_corrected_by"] for record in records),
            "raw_noise_ratio_median": before["noise_ratio_median"],
            "raw_noise_ratio_p95": before["noise_ratio_p95"],
        }
    common = [*whole.scene.notes, *map(half_note, PHOTODIODES)]
    notes = {
        name: [note for note in light.notes if note not in common]
        for name, light in lights.items()
    }
    more = []
    if stop.asked is not None and stop.asked != samples:
        more.append(
            f"took {samples} samples per pixel in {len(parts)} light groups together instead of {stop.asked}, because "
            f"each group takes equal passes and at least {PASSES_MIN} samples"
        )
    return replace(
        parts[0],
        passes=passes,
        samples_per_pixel=samples,
        seconds=seconds,
        seconds_per_sample=sample_s / samples,
        **(before if denoised is None else ratios(total.relative_error, POOLED)),
        reliable=all(part.reliable for part in parts),
        firefly_fraction=max(part.firefly_fraction for part in parts),
        negative=sum(part.negative for part in parts),
        non_finite=sum(part.non_finite for part in parts),
        notes=(*whole.scene.notes, *notes_of_groups(notes), *more),
        scene_sha256=whole.scene.sha256,
        denoised=denoised,
        sum_error=total.error_of_sum(),
        motion=coarsest(part.motion for part in parts),
    )
