"""Raw frames of a scene that each have a render of their own: render_frames()."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Unpack

from .camera.camera_file import AnyCamera, camera_of
from .core import Photons, warn_of
from .core.options import complete, documents
from .core.progress import is_asked
from .output.frames import Frames
from .render.light.irradiance import Irradiance
from .render.options import FrameSeriesOptions
from .render.passes.per_frame import FrameSeries, PerFrameNoise
from .render.passes.render_notes import notes_after_render
from .render.passes.stop_criterion import Progress
from .render.passes.told import told_progress
from .render.scene.parse_scene import SceneInput
from .render.scene.parsed_scene import ParsedScene
from .render.variants import computed_in, restores_variant
from .sensor.metering import AskedExposure


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """One frame, and the render that it was made from.

    uncompensated : what is left of the render's variance over the shot variance, averaged over the pixels: the frame is
        that much too noisy; without compensation, all of it.
    above_shot_noise : share of the pixels whose render has more variance than their shot noise: only more samples help.
    """

    frames: Frames
    light: Irradiance
    photons: Photons
    uncompensated: float
    above_shot_noise: float


@documents(FrameSeriesOptions)
@restores_variant
def render_frames(
    scene: SceneInput | ParsedScene,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    *,
    render_noise: PerFrameNoise = "compensated",
    progress: Progress | bool | None = None,
    **options: Unpack[FrameSeriesOptions],
) -> Iterator[RenderedFrame]:
    """Frames of a scene, each from a render with a seed of its own; one at a time, all checked before the first.

    ::

        for rendered in ms.render_frames("cornell_box", camera, exposure, frames=8, width=64):
            print(rendered.frames.digital.mean())

    render_noise : "compensated" counts the render's noise as part of the shot noise, so that 16 times fewer samples are
        enough than for a noise ratio of 0.01; "per-frame" adds it to the shot noise.
    progress : None says every ten seconds on stderr how far it is, in a notebook by a bar; False says nothing; a
        function is called with a :class:`render.passes.stop_criterion.RenderProgress` of each frame's render.

    By default "compensated" renders until the median of v/μ, the variance of the render over that of the shot noise,
    is 1/6, and at most 1 % is left uncompensated outside the noisiest 1 % of the pixels; ``spectral`` is "channels",
    since each render is used once. A render before the first frame determines the samples of all, and which pixels get
    several times as many (noisy_pixels.py; not in scalar variants). Raises InputError.
    """
    if not callable(progress):
        is_asked(progress)  # before the first frame is asked for
    chosen = complete(FrameSeriesOptions, options)
    series = FrameSeries.prepare(scene, camera_of(camera), exposure, chosen, render_noise)
    told = {**chosen, "render_noise": render_noise}
    shown = told_progress(progress, "render_frames", told, thread=False)
    return computed_in(series.prepared.parsed.variant, _frames_of(series, shown))


def _frames_of(
    series: FrameSeries, shown: AbstractContextManager[Progress | None]
) -> Iterator[RenderedFrame]:
    """One frame after the other; with the first one Python warns of the doubts, which are those of all."""
    with shown as progress:
        for number, render in enumerate(series.renders(progress)):
            frames = Frames.exposed(render.exposed)
            if not number:
                warn_of(notes_after_render(render.light, frames))
            yield RenderedFrame(
                frames,
                render.light,
                render.photons,
                render.uncompensated,
                render.above_shot_noise,
            )
