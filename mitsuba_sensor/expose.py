"""Light in, raw frames out: expose() and stream() of mean photons or of irradiance, render_frames() of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .core import Exposure, Photons, warn_of
from .core.options import complete, documents
from .output.frames import Frames
from .render.light.irradiance import Irradiance
from .render.light.photons import collected
from .render.options import FrameSeriesOptions
from .render.passes.per_frame import FrameSeries, PerFrameNoise
from .render.passes.stop_criterion import Progress
from .render.scene.scene_nodes import SceneInput
from .render.scene.scene_settings import ParsedScene
from .render.variants import computed_in, restores_variant
from .sensor.camera import Camera
from .sensor.expose import PreparedExposure, exposure_of_photons
from .sensor.metering import AskedExposure
from .sensor.options import ExposeOptions


@documents(ExposeOptions)
def expose(
    photons: Photons | ArrayLike | Irradiance,
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    **options: Unpack[ExposeOptions],
) -> Frames:
    """Raw frames that ``camera`` delivers for these mean photons per pixel.

    photons : what :func:`collect` returns, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B. Or the Irradiance itself, which is collected: then camera, exposure and serial
        number are by default those that it was rendered for, and the exposure may be "auto" (metered).
    A SensorWarning says where the result is probably not the one that was wanted; the frames' ``notes`` say it too.
    Raises InputError for NaN or negative photons, naming how many there are and where the first one is.
    """
    frames = Frames.exposed(prepare_light(photons, camera, exposure, options))
    warn_of(frames.exposure_notes)
    return frames


@documents(ExposeOptions)
def stream(
    photons: Photons | ArrayLike | Irradiance,
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    **options: Unpack[ExposeOptions],
) -> Iterator[NDArray[np.unsignedinteger]]:
    """The frames of :func:`expose` one at a time, each (H, W) [DN]: for more of them than memory holds.

    Everything is checked at once; light and maps are made with the first frame that is asked for.
    """
    sensor = prepare_light(photons, camera, exposure, options)
    frames = sensor.stream()
    warn_of(sensor.notes)
    return frames


def prepare_light(
    light: Photons | ArrayLike | Irradiance,
    camera: Camera | None,
    exposure: AskedExposure | None,
    options: ExposeOptions,
) -> PreparedExposure:
    """An exposure with its light, which is collected where it is the irradiance of a render. Raises InputError."""
    if isinstance(light, Irradiance):
        asked = options.get("serial"), options.get("gain")
        photons, camera, exposure, serial = collected(light, camera, exposure, *asked)
        return exposure_of_photons(photons, camera, exposure, {**options, "serial": serial})
    return exposure_of_photons(light, cast(Camera, camera), cast(Exposure, exposure), options)  # checked there


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
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    *,
    render_noise: PerFrameNoise = "compensated",
    progress: Progress | None = None,
    **options: Unpack[FrameSeriesOptions],
) -> Iterator[RenderedFrame]:
    """Frames of a scene, each from a render with a seed of its own; one at a time, all checked before the first.

    render_noise : "compensated" counts the render's noise as part of the shot noise, so that 16 times fewer samples are
        enough than for a noise ratio of 0.01; "per-frame" adds it to the shot noise.
    progress : called with a :class:`render.passes.stop_criterion.RenderProgress` of each frame's render.

    By default "compensated" renders until the median of v/μ, the variance of the render over that of the shot noise,
    is 1/6, and at most 1 % is left uncompensated outside the noisiest 1 % of the pixels; ``spectral`` is "channels",
    since each render is used once. A render before the first frame determines the samples of all, and which pixels get
    several times as many (noisy_pixels.py; not in scalar variants). Raises InputError.
    """
    chosen = complete(FrameSeriesOptions, options)
    series = FrameSeries.prepare(scene, camera, exposure, chosen, render_noise)
    return computed_in(series.prepared.parsed.variant, _frames_of(series, progress))


def _frames_of(series: FrameSeries, progress: Progress | None) -> Iterator[RenderedFrame]:
    """One frame after the other; with the first one Python warns of the doubts, which are those of all."""
    for number, render in enumerate(series.renders(progress)):
        frames = Frames.exposed(render.exposed)
        if not number:
            warn_of((*render.light.notes, *frames.exposure_notes))
        yield RenderedFrame(frames, render.light, render.photons, render.uncompensated, render.above_shot_noise)
