"""Frames that follow each other in time, each with the light, exposure and gain of its time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple, TypeAlias, cast

from .camera.dual_pixels import has_several_readouts
from .capture_options import CaptureOptions, LightOptions
from .core import Exposure, Photons
from .core.options import part_of
from .files.png import write_webp
from .output.frame_files import VIDEO
from .output.frames import Frames
from .render.light.irradiance import Irradiance
from .render.light.photons import photons_of
from .render.passes.stop_criterion import Progress, RenderProgress
from .sensor.auto_exposure import AutoExposure, ExposureControl
from .sensor.expose import PreparedExposure
from .sensor.frame_times import FrameTimes
from .sensor.frames import KEEP
from .sensor.kept_maps import RECENT_BYTES, KeptMaps, depends_on_camera_alone
from .sensor.options import ExposeOptions
from .stages.image_lag import BEFORE
from .theory.plan import prepare_planned_exposure

LightOfFrame = Callable[[int, float, Exposure], Irradiance]
"""Returns the light of a frame from its number, start [s] and exposure."""


class TimedFrame(NamedTuple):
    """A frame with its time.

    start_s : when exposure of the first row begins.  frames : this frame, with the camera at its gain.
    camera_to_world : pose of the camera at that time; None for light from elsewhere.
    measured : mean above black over saturation, with automatic exposure.
    """

    start_s: float
    frames: Frames
    camera_to_world: Sequence[Sequence[float]] | None
    measured: float | None = None

    def to_dict(self) -> dict[str, object]:
        """Return plain values for JSON."""
        first, camera = self.frames.first, self.frames.camera
        return {
            "frame": first.index,
            "start_s": self.start_s,
            "exposure_s": first.exposure.time_s,
            "gain": camera.gain,
            "camera_to_world": self.camera_to_world,
            "measured": self.measured,
        }


def frames_in_time(
    sensor: PreparedExposure,
    light_of: LightOfFrame,
    options: ExposeOptions,
    rule: AutoExposure | None = None,
    *,
    with_clean: bool = False,
) -> Iterator[TimedFrame]:
    """Yield frames, each in the light of its time.

    sensor : of the first frame; the others differ in time, exposure, gain and light.
    rule : of automatic exposure.
    Raises InputError at once for an exposure that is longer than a frame.
    """
    times, first, kept = FrameTimes.of(options), sensor.first, KeptMaps(RECENT_BYTES)
    control = None
    if rule is not None:
        assert times.period_s is not None
        control = ExposureControl.begin(rule, sensor.camera, first.exposure, times.period_s)
    times.check(control.exposure if control else first.exposure, sensor.camera)

    def light_at(number: int) -> tuple[Irradiance, Photons]:
        camera, exposure = sensor.camera, first.exposure
        if control is not None:
            camera, exposure = control.camera, control.exposure
        start_s = times.of_frame(number)
        light = light_of(number, start_s, exposure)
        return light, photons_of(light, camera, exposure, start_s)

    def sensor_at_gain() -> PreparedExposure:
        """Return the exposure of one frame, with the FPN maps of the frames before."""
        one = sensor
        if control is not None and control.camera is not sensor.camera:
            seeds: ExposeOptions = {"seed": first.seed, "serial": first.window.serial}
            asked: ExposeOptions = {**options, **seeds, "gain": None}
            shape, origin = first.window.shape, first.window.origin
            one = prepare_planned_exposure(control.camera, first.exposure, shape, origin, asked)
        one = replace(one, count=1, told=None)
        if depends_on_camera_alone(one):
            one = kept.lend(one)
        return one.at(control.exposure if control else first.exposure)

    def each() -> Iterator[TimedFrame]:
        lags, before = sensor.camera.quantum_efficiency.image_lag > 0, None
        if lags and first.index > 0:
            before = light_at(first.index - 1)[1]
        for number in range(first.index, first.index + sensor.count):
            light, photons = light_at(number)
            lit = photons
            if before is not None:
                lit = photons.changed(by_readout={BEFORE: before})
            one = sensor_at_gain().of(lit, number)
            before = photons if lags else None
            frames = Frames.exposed(one)
            if with_clean:
                frames = replace(frames, own_clean=frames.clean[None])
            measured = None if control is None else control.measure(frames.digital[0])
            pose = light.statistics.camera_to_world
            yield TimedFrame(times.of_frame(number), frames, pose, measured)
            if sensor.told is not None:
                sensor.told(number - first.index + 1)

    return each()


FramesInTime: TypeAlias = tuple[Frames, tuple[TimedFrame, ...]]
"""All frames together, and one by one if they follow each other in time."""


def expose_frames(
    sensor: PreparedExposure,
    light: Irradiance,
    options: CaptureOptions | LightOptions,
    progress: Progress | None = None,
) -> FramesInTime:
    """Expose frames of one render, all at once if they differ in noise only.

    sensor : with the light of the first frame.  Raises InputError for an exposure that is longer than a frame.
    """
    sensor, times = told_of(sensor, progress), FrameTimes.of(options)
    if times.period_s is None or not (light.waveforms or options["auto_exposure"]):
        times.check(sensor.first.exposure, sensor.camera)
        frames = Frames.exposed(sensor)
        return frames, tuple(_of_still_light(frames, light, times))
    return expose_moving(sensor, lambda *frame: light, options)


def expose_moving(
    sensor: PreparedExposure, light_of: LightOfFrame, options: CaptureOptions | LightOptions
) -> FramesInTime:
    """Expose frames that each have the light of their time."""
    rule = cast(AutoExposure | None, options["auto_exposure"])
    with_clean, asked = options["clean"], part_of(ExposeOptions, options)
    series = frames_in_time(sensor, light_of, asked, rule, with_clean=with_clean)
    return joined(series, with_clean)


def _of_still_light(
    frames: Frames, light: Irradiance, times: FrameTimes
) -> Iterator[TimedFrame]:
    """Yield the frames one by one if they follow each other in time, else nothing."""
    if times.period_s is None:
        return
    kept = [name for name in ("digital", *KEEP) if getattr(frames, name) is not None]
    for k in range(len(frames.digital)):
        number = frames.first.index + k
        first = replace(frames.first, index=number, _blocks={})
        own = {name: getattr(frames, name)[k : k + 1] for name in kept}
        one = replace(frames, first=first, counted=frames.counted if k == 0 else None, **own)
        yield TimedFrame(times.of_frame(number), one, light.statistics.camera_to_world)


def told_of(sensor: PreparedExposure, progress: Progress | None) -> PreparedExposure:
    """Return the exposure, which reports progress after each frame."""
    if progress is None:
        return sensor
    began, count = time.monotonic(), sensor.count

    def tell(done: int) -> None:
        seconds = time.monotonic() - began
        progress(RenderProgress(done, count, seconds=seconds, doing="exposing"))

    tell(0)
    return replace(sensor, told=tell)


def joined(series: Iterator[TimedFrame], with_clean: bool = False) -> FramesInTime:
    """Return all frames as one, with theory and report of the first, and one by one; only the first keeps its light."""
    timed = list[TimedFrame]()
    for one in series:
        if timed:
            first = timed[0].frames
            readouts = None
            if has_several_readouts(first.camera):
                readouts = one.frames.readouts  # while its light is there
            frames = replace(
                one.frames,
                light=first.light,
                detected=first.detected,
                own_readouts=readouts,
            )
            one = one._replace(frames=frames)
        timed.append(one)
    return Frames.joined([one.frames for one in timed], with_clean), tuple(timed)


def series_facts(
    timed: Sequence[TimedFrame], options: Mapping[str, object]
) -> dict[str, object] | None:
    """Return time, pose, exposure and gain of every frame for frame.json; None unless they follow each other."""
    if not timed:
        return None
    return {
        **asdict(FrameTimes.of(options)),
        "frames": [one.to_dict() for one in timed],
    }


def write_video(folder: Path, timed: Sequence[TimedFrame], gain: float) -> None:
    """Write frames.webp, the previews of a series of frames.  gain : of the previews."""
    if len(timed) > 1:
        pictures = [one.frames.preview(0, gain) for one in timed]
        write_webp(folder / VIDEO, pictures, timed[1].start_s - timed[0].start_s)
