"""The frames of a capture: of rendered light, of one render, or of a render for each frame."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias, cast

from .camera.camera import Camera
from .capture_options import CaptureOptions, refuse_render_options
from .core import Exposure, InputError
from .core.heap import trim_heap
from .core.options import part_of, used
from .output.dng import check_dng
from .output.frames import Frames
from .output.light_files import read_irradiance
from .render.light.irradiance import Irradiance
from .render.light.light_sum import check_group_names, waveforms_of
from .render.light.photons import collected, metered, photons_of
from .render.motion.moving_scene import MovingScene
from .render.options import FrameSeriesOptions, RenderOptions
from .render.passes.per_frame import FrameSeries
from .render.passes.prepared import PreparedRender, prepare
from .render.passes.stop_criterion import Progress, RenderProgress, StopCriterion
from .render.samples import hashed_seed
from .render.scene.parse_scene import SceneInput
from .render.scene.parsed_scene import ParsedScene
from .sensor.expose import PreparedExposure
from .sensor.frame_times import FrameTimes
from .sensor.metering import Metering
from .sensor.options import ExposeOptions
from .theory.plan import prepare_planned_exposure
from .timed_frames import TimedFrame, expose_frames, expose_moving

Scene: TypeAlias = SceneInput | ParsedScene
Light: TypeAlias = str | os.PathLike[str] | Irradiance


@dataclass(frozen=True, eq=False)
class Request:
    """Arguments of a capture.

    camera, exposure : None for those of the scene or the light.  options : completed.
    times_s : collects the wall-clock seconds of each step.
    """

    source: Scene | Light
    camera: Camera | None
    exposure: Exposure | Metering | None
    options: CaptureOptions
    progress: Progress | None
    times_s: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Exposed:
    """Frames and their light.

    origin : of the light, for the metadata.  options : with the serial number of the light.
    render : of the scene; None for light that was rendered before.  timed : frames that follow each other in time.
    """

    frames: Frames
    light: Irradiance
    origin: Mapping[str, object]
    options: CaptureOptions
    render: PreparedRender | None = None
    timed: tuple[TimedFrame, ...] = ()


def expose_light(request: Request) -> Exposed:
    """Expose light that is rendered already."""
    refuse_render_options(request.options)
    source = cast(Light, request.source)
    path = None if isinstance(source, Irradiance) else Path(source)
    with timed(request.times_s, "read irradiance"):
        light = source if isinstance(source, Irradiance) else read_irradiance(source)
        light = light.before_denoising() if request.options["raw_light"] else light
        light = lit_as_asked(light, request.options)
    begin_s = FrameTimes.of(request.options).of_frame(request.options["first_frame"])
    asked = request.options["serial"], request.options["gain"], begin_s
    photons, camera, exposure, serial = collected(
        light, request.camera, request.exposure, *asked
    )
    options: CaptureOptions = {**request.options, "serial": serial}
    metering = request.exposure
    if metering is None and light.rendered_for is None:
        metering = Metering()
    origin = {
        "irradiance": path,
        "as_rendered": light.rendered_for.shared_with(camera, exposure, serial)
        if light.rendered_for
        else [],
        "metering": metering.record(exposure) if isinstance(metering, Metering) else None,
    }
    sensor = prepare_planned_exposure(
        camera, exposure, light.data.shape[:2], light.origin, part_of(ExposeOptions, options)
    )
    check_frame_files(sensor, options)
    with timed(request.times_s, "expose"):
        frames, series = expose_frames(sensor.of(photons), light, options, request.progress)
    return Exposed(frames, light, origin, options, timed=series)


def render_once(request: Request) -> Exposed:
    """Expose one render of a scene, or a render for each frame if something moves in time."""
    options, progress = request.options, request.progress
    times = FrameTimes.of(options)
    rendering = part_of(RenderOptions, options)
    rendering["start_s"] = times.of_frame(options["first_frame"])
    with timed(request.times_s, "render"):
        started = time.monotonic()
        given = cast(Scene, request.source), request.camera, request.exposure
        render = prepare(*given, **rendering)
        render = replace(render, waveforms=waveforms_of(options["lights"] or {}))
        sensor = render.sensor(part_of(ExposeOptions, options))
        check_frame_files(sensor, options)  # before the first ray
        if options["lights"] is not None:
            check_group_names(options["lights"], [group.name for group in render.light_groups])
        if render.metering is None and options["auto_exposure"] is None:
            times.check(render.exposure, render.camera)
        stop = render.stop_criterion(rendering)
        if isinstance(render.scene, MovingScene) and times.period_s is not None:
            return render_in_time(request, render, sensor, stop)
        light = render.render(sensor.first.seed, stop, progress, started=started)
    with timed(request.times_s, "expose"):
        exposure = render.exposure_of(light)
        lit = lit_as_asked(light, options)
        if lit is not light and render.metering is not None:
            exposure = metered(lit, render.camera, render.metering)
            lit = metered_at(lit, render.metering, exposure)
        photons = photons_of(lit, render.camera, exposure, rendering["start_s"])
        frames, series = expose_frames(sensor.at(exposure).of(photons), lit, options, progress)
    return replace(exposed_of_scene(request, render, lit, frames), timed=series)


def metered_at(light: Irradiance, metering: Metering, exposure: Exposure) -> Irradiance:
    """Return the light with the exposure that was metered in it."""
    assert light.rendered_for is not None
    statistics = replace(light.statistics, metering=metering.record(exposure))
    rendered_for = replace(light.rendered_for, exposure=exposure)
    return replace(light, statistics=statistics, rendered_for=rendered_for)


def render_in_time(
    request: Request, render: PreparedRender, sensor: PreparedExposure, stop: StopCriterion
) -> Exposed:
    """Expose a render of a moving scene for every frame; irradiance and metadata are those of the first."""
    options, progress, seed = request.options, request.progress, sensor.first.seed
    assert isinstance(render.scene, MovingScene)
    subframes, lights = render.scene.asked_subframes, list[Irradiance]()

    def light_of(number: int, begin_s: float, exposure: Exposure) -> Irradiance:
        one = render.moved_to(render.motion, begin_s, exposure, subframes)

        def tell(step: RenderProgress) -> None:
            if progress is not None:
                progress(replace(step, frame=number))

        light = one.render(hashed_seed(seed, -3, number) if number else seed, stop, tell)
        lit = lit_as_asked(light, options)
        if number >= options["first_frame"] and not lights:
            lights.append(lit)
        return lit

    frames, series = expose_moving(sensor, light_of, options)
    return replace(exposed_of_scene(request, render, lights[0], frames), timed=series)


def lit_as_asked(light: Irradiance, options: CaptureOptions) -> Irradiance:
    """Return the light with the levels of its groups that were asked for."""
    return light if options["lights"] is None else light.with_lights(options["lights"])


def render_each_frame(request: Request) -> Exposed:
    """Expose a render of a scene for every frame; irradiance and metadata are those of the first."""
    options = request.options
    if options["light_groups"] is not None or options["lights"] is not None:
        raise InputError(
            "render_noise is 'per-frame', but light_groups are for later exposures of one render; omit one of them."
        )
    with timed(request.times_s, "render and expose"):
        scene, series_options = (
            cast(Scene, request.source),
            part_of(FrameSeriesOptions, options),
        )
        series = FrameSeries.prepare(scene, request.camera, request.exposure, series_options)
        check_frame_files(series.sensor, options)
        lights, parts = list[Irradiance](), list[Frames]()
        for exposed, light, _ in series.renders(request.progress):
            lights = lights or [light]
            parts.append(Frames.exposed(exposed))
    frames = Frames.joined(parts, with_clean=options["clean"])
    return exposed_of_scene(request, series.prepared, lights[0], frames)


def exposed_of_scene(
    request: Request,
    render: PreparedRender,
    light: Irradiance,
    frames: Frames,
) -> Exposed:
    """Return the result for frames of a scene."""
    options = request.options
    origin = {
        "scene": render.parsed.path,
        "parameters": dict(options["parameters"] or {}),
        "motion": used(CaptureOptions, options)["motion"],
        "render_noise": options["render_noise"],
        "metering": light.statistics.metering,
    }
    return Exposed(frames, light.of_serial(frames.first.window.serial), origin, options, render)


def check_frame_files(sensor: PreparedExposure, options: CaptureOptions) -> None:
    """Raise InputError for more frames than memory holds, and for frames that a DNG file cannot hold."""
    sensor.check_memory(options["frames"])
    if options["dng"]:
        check_dng(sensor.camera, sensor.first.window.shape)


@contextmanager
def timed(times_s: dict[str, float], name: str) -> Iterator[None]:
    """Record the wall-clock seconds of the block, and free its memory."""
    start = time.perf_counter()
    yield
    trim_heap()
    times_s[name] = round(time.perf_counter() - start, 4)
