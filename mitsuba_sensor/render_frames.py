"""Raw frames of a scene, each from its own render: render_frames()."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Unpack

from .camera.camera_file import AnyCamera, camera_of
from .core import Photons, warn_of
from .core.options import complete, documents
from .core.progress import is_asked
from .output.frames import Frames, notes_after_render
from .render.light.irradiance import Irradiance
from .render.options import FrameSeriesOptions
from .render.passes.per_frame import FrameSeries
from .render.passes.stop_criterion import Progress, told_progress
from .render.scene.parse_scene import SceneInput
from .render.scene.parsed_scene import ParsedScene
from .render.variants import computed_in, restores_variant
from .sensor.metering import AskedExposure


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """One frame and its render."""

    frames: Frames
    light: Irradiance
    photons: Photons


@documents(FrameSeriesOptions)
@restores_variant
def render_frames(
    scene: SceneInput | ParsedScene,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    *,
    progress: Progress | bool | None = None,
    **options: Unpack[FrameSeriesOptions],
) -> Iterator[RenderedFrame]:
    """Yield frames of a scene, each from a render with its own seed; arguments are checked before the first.

    ::

        for rendered in ms.render_frames("cornell_box", camera, exposure, frames=8, width=64):
            print(rendered.frames.digital.mean())

    progress : None reports on stderr every ten seconds; False is silent; a function is called with a
        :class:`render.passes.stop_criterion.RenderProgress` of each frame's render.

    The noise of each render adds to the noise of its frame, instead of being the same in all frames. The default of
    ``spectral`` is "channels", since each render is used once. Raises InputError.
    """
    if not callable(progress):
        is_asked(progress)  # before the first frame is asked for
    chosen = complete(FrameSeriesOptions, options)
    series = FrameSeries.prepare(scene, camera_of(camera), exposure, chosen)
    told = {**chosen, "render_noise": "per-frame"}
    shown = told_progress(progress, "render_frames", told, thread=False)
    return computed_in(series.prepared.parsed.variant, _frames_of(series, shown))


def _frames_of(
    series: FrameSeries, shown: AbstractContextManager[Progress | None]
) -> Iterator[RenderedFrame]:
    """Yield the frames; warn with the first, whose notes are those of all."""
    with shown as progress:
        for number, (exposed, light, photons) in enumerate(series.renders(progress)):
            frames = Frames.exposed(exposed)
            if not number:
                warn_of(notes_after_render(light, frames))
            yield RenderedFrame(frames, light, photons)
