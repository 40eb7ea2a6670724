"""What is noted of a render when it has ended: samples, noise, view, what the denoiser did."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from ...core import Caution, Exposure
from ...optics.image_record import image_record
from ...optics.intrinsics import aperture_f_number
from ..motion.moving_scene import pose_m
from .render_notes import render_notes
from .renderer import Electrons
from .statistics import POOLED, RenderStatistics, sum_error, why_not_trusted
from .stop_criterion import End, StopCriterion

if TYPE_CHECKING:
    from .prepared import PreparedRender


def statistics_of(
    render: PreparedRender,
    stop: StopCriterion,
    end: End,
    started: float,
    exposure: Exposure,
    raw: Electrons,
) -> RenderStatistics:
    """How a render came about.

    started : when it began, on the monotonic clock [s].  raw : mean and variance of its photoelectrons, not denoised.
    """
    renderer, passes = render.renderer, render.renderer.passes
    fireflies, samples = renderer.firefly_fraction(), renderer.samples_per_pixel
    doubt, choice = why_not_trusted(passes, fireflies, renderer.lost), renderer.choice
    notes = render_notes(render, stop, end)
    doubts = [Caution(doubt)] if doubt else []
    hints = [render.parsed.variant.hint] if render.parsed.variant.hint else []
    return RenderStatistics(
        passes=passes,
        samples_per_pixel=samples,
        seconds=time.monotonic() - started,
        seconds_per_sample=renderer.seconds_per_sample,
        variant=render.parsed.variant.name,
        sampler=render.sampler,
        spectral=render.bands.kind,
        **render.noise_ratios(
            exposure, renderer.electrons(), passes if renderer.denoised is None else POOLED
        ),
        noise_ratio_asked=stop.goal if stop.reached == "noise_ratio" else None,
        ended_by=end,
        reliable=not doubt,
        firefly_fraction=fireflies,
        negative=renderer.negative,
        non_finite=renderer.non_finite,
        notes=(*notes, *doubts, *hints),
        facts=tuple(str(one) for one in render.at_rest.findings if one.level == "fact"),
        scene_sha256=render.scene.sha256,
        aperture_f_number=aperture_f_number(render.scene.view, render.camera),
        intrinsics=image_record(render.scene.view, render.camera),
        camera_to_world=pose_m(
            render.at_rest, render.motion, render.unit_m, render.begin_s
        ).tolist(),
        denoised=_denoised(render, exposure, raw),
        denoise_forecast=None if choice is None else choice.record(),
        metering=None if render.metering is None else render.metering.record(exposure),
        sum_error=sum_error(*raw),
        motion=render.scene.time_sampling(),
    )


def _denoised(
    render: PreparedRender, exposure: Exposure, raw: Electrons
) -> dict[str, object] | None:
    """What the denoiser did, and the noise ratio before."""
    if (found := render.renderer.denoised) is None:
        return None
    before = render.noise_ratios(exposure, raw, render.renderer.passes)
    median, p95 = before["noise_ratio_median"], before["noise_ratio_p95"]
    return {**found.record, "raw_noise_ratio_median": median, "raw_noise_ratio_p95": p95}
