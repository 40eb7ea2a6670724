"""Frames that follow each other in time: each in the light, and with the exposure and gain, of its own time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from .camera.camera import Camera
from .camera.dual_pixels import has_several_readouts
from .capture_options import CaptureOptions, LightOptions
from .core import Exposure, Float64Array, Photons
from .core.options import part_of
from .files.webp import write_webp
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
from .stages.gains import gain_dn_per_e
from .stages.image_lag import BEFORE
from .theory.plan import prepare_planned_exposure

REGIONS = 8
"""Along each side of the picture: of their means is the largest flicker modulation index."""
TINY_S = 1e-12
DIMMEST = 0.02
"""Of the brightest region's mean: darker regions do not count."""

LightOfFrame = Callable[[int, float, Exposure], Irradiance]
"""The light of a frame by its number, when it begins [s], and its exposure."""


class TimedFrame(NamedTuple):
    """A frame, and what is known of its time.

    start_s : when its first row opens.  frames : it alone, with the camera at its gain.
    camera_to_world : pose of the camera at that time; None for light from elsewhere.
    measured : mean over black as a share of saturation, where exposure is automatic.
    """

    start_s: float
    frames: Frames
    camera_to_world: Sequence[Sequence[float]] | None
    measured: float | None = None

    def to_dict(self) -> dict[str, object]:
        """Plain values, ready for JSON."""
        first, camera = self.frames.first, self.frames.camera
        return {
            "frame": first.index,
            "start_s": self.start_s,
            "exposure_s": first.exposure.time_s,
            "gain": camera.gain,
            "camera_to_world": self.camera_to_world,
            "measured": self.measured,
        }


@dataclass(frozen=True, eq=False)
class TimedExposure:
    """Frames to be exposed one after the other.

    sensor : of the first frame, which every frame has but for its time, exposure, gain and light.
    light_of : the light of each.  options : of the exposure.  control : automatic exposure, or None.
    """

    sensor: PreparedExposure
    light_of: LightOfFrame
    times: FrameTimes
    options: ExposeOptions
    control: ExposureControl | None = None
    kept: KeptMaps = field(default_factory=partial(KeptMaps, RECENT_BYTES))

    def each(self, report: bool = False, with_clean: bool = False) -> Iterator[TimedFrame]:
        """One frame at a time, the first with its report if it is asked for."""
        sensor, control, first = self.sensor, self.control, self.sensor.first
        before = self._before(first.index)
        for number in range(first.index, first.index + sensor.count):
            camera, exposure = sensor.camera, first.exposure
            if control is not None:
                camera, exposure = control.camera, control.exposure
            start_s = self.times.of_frame(number)
            light = self.light_of(number, start_s, exposure)
            photons = photons_of(light, camera, exposure, start_s)
            one = self._sensor_of(camera).at(exposure).of(after(before, photons), number)
            before = photons if camera.quantum_efficiency.image_lag else None
            frames = Frames.exposed(one, followed=report and number == first.index)
            if with_clean:
                frames = replace(frames, own_clean=frames.clean[None])
            measured = None if control is None else control.measure(frames.digital[0])
            yield TimedFrame(start_s, frames, light.statistics.camera_to_world, measured)
            if sensor.told is not None:
                sensor.told(number - first.index + 1)

    def _before(self, number: int) -> Photons | None:
        """The light of the frame before this one, of a camera with image lag; None before frame 0."""
        camera, exposure = self.sensor.camera, self.sensor.first.exposure
        if not camera.quantum_efficiency.image_lag or number == 0:
            return None
        if self.control is not None:
            exposure = self.control.exposure
        start_s = self.times.of_frame(number - 1)
        light = self.light_of(number - 1, start_s, exposure)
        return photons_of(light, camera, exposure, start_s)

    def _sensor_of(self, camera: Camera) -> PreparedExposure:
        """The sensor at the gain of this camera, for one frame, with the FPN maps of the frames before."""
        sensor, first = self.sensor, self.sensor.first
        if camera is not sensor.camera:
            seeds: ExposeOptions = {"seed": first.seed, "serial": first.window.serial}
            options: ExposeOptions = {**self.options, **seeds, "gain": None}
            shape, origin = first.window.shape, first.window.origin
            sensor = prepare_planned_exposure(camera, first.exposure, shape, origin, options)
        sensor = replace(sensor, count=1, told=None)
        return self.kept.lend(sensor) if depends_on_camera_alone(sensor) else sensor


def after(before: Photons | None, photons: Photons) -> Photons:
    """Light of a frame with that of the frame before; without it where that is the same or not asked for."""
    if before is None:
        return photons
    return photons.changed(by_readout={BEFORE: before})


class TimedFrames(NamedTuple):
    """All frames as one, and one by one where they follow each other in time."""

    frames: Frames
    timed: tuple[TimedFrame, ...] = ()


def expose_frames(
    sensor: PreparedExposure,
    light: Irradiance,
    options: CaptureOptions | LightOptions,
    progress: Progress | None = None,
) -> TimedFrames:
    """Frames of light that is rendered once: at once where they differ in their noise alone.

    sensor : with the light of the first frame.  Raises InputError for an exposure that is longer than a frame.
    """
    sensor, times = told_of(sensor, progress), FrameTimes.of(options)
    if times.period_s is None or not (light.waveforms or options["auto_exposure"]):
        times.check(sensor.first.exposure, sensor.camera)
        frames = Frames.exposed(sensor, followed=True)
        return TimedFrames(frames, tuple(_of_still_light(frames, light, times)))
    return expose_moving(sensor, lambda *frame: light, options)


def expose_moving(
    sensor: PreparedExposure, light_of: LightOfFrame, options: CaptureOptions | LightOptions
) -> TimedFrames:
    """Frames that each have the light of their own time."""
    rule = cast(AutoExposure | None, options["auto_exposure"])
    series = timed_exposure(sensor, light_of, part_of(ExposeOptions, options), rule)
    with_clean = options["clean"]
    return joined(series.each(report=True, with_clean=with_clean), with_clean)


def _of_still_light(
    frames: Frames, light: Irradiance, times: FrameTimes
) -> Iterator[TimedFrame]:
    """The frames one by one; none where they do not follow each other in time."""
    if times.period_s is None:
        return
    kept = [name for name in ("digital", *KEEP) if getattr(frames, name) is not None]
    for k in range(len(frames.digital)):
        number = frames.first.index + k
        first = replace(frames.first, index=number, _blocks={})
        own = {name: getattr(frames, name)[k : k + 1] for name in kept}
        one = replace(frames, first=first, observer=None, **own)
        yield TimedFrame(times.of_frame(number), one, light.statistics.camera_to_world)


def told_of(sensor: PreparedExposure, progress: Progress | None) -> PreparedExposure:
    """The exposure; progress is told after each of its frames."""
    if progress is None:
        return sensor
    began, count = time.monotonic(), sensor.count

    def tell(done: int) -> None:
        seconds = time.monotonic() - began
        progress(RenderProgress(done, count, seconds=seconds, doing="exposing"))

    tell(0)
    return replace(sensor, told=tell)


def timed_exposure(
    sensor: PreparedExposure,
    light_of: LightOfFrame,
    options: ExposeOptions,
    rule: AutoExposure | None = None,
) -> TimedExposure:
    """Frames at the times that the options ask for.  rule : of automatic exposure. Raises InputError."""
    times, control, exposure = FrameTimes.of(options), None, sensor.first.exposure
    if rule is not None:
        assert times.period_s is not None
        control = ExposureControl.begin(rule, sensor.camera, exposure, times.period_s)
        exposure = control.exposure
    times.check(exposure, sensor.camera)
    return TimedExposure(sensor, light_of, times, options, control)


def joined(series: Iterator[TimedFrame], with_clean: bool = False) -> TimedFrames:
    """All frames as one, with theory and report of the first, and one by one; only the light of the first is kept."""
    timed = list[TimedFrame]()
    for one in series:
        if timed:
            first = timed[0].frames
            readouts = None
            if has_several_readouts(first.camera):
                readouts = one.frames.readouts  # of its own light, which is not kept
            frames = replace(
                one.frames,
                light=first.light,
                detected=first.detected,
                own_readouts=readouts,
            )
            one = one._replace(frames=frames)
        timed.append(one)
    return TimedFrames(Frames.joined([one.frames for one in timed], with_clean), tuple(timed))


def series_facts(
    timed: Sequence[TimedFrame], options: Mapping[str, object]
) -> dict[str, object] | None:
    """Times, poses, exposure and gain of every frame, and how much the frames flicker, for frame.json; None where they
    do not follow each other in time."""
    if not timed:
        return None
    return {
        **asdict(FrameTimes.of(options)),
        **flicker(timed),
        "frames": [one.to_dict() for one in timed],
    }


def write_video(folder: Path, timed: Sequence[TimedFrame], gain: float) -> None:
    """frames.webp: the previews of several frames that follow each other in time.  gain : of the previews."""
    if len(timed) > 1:
        pictures = [one.frames.preview(0, gain) for one in timed]
        write_webp(folder / VIDEO, pictures, timed[1].start_s - timed[0].start_s)


def flicker(timed: Sequence[TimedFrame]) -> dict[str, float | None]:
    """Flicker modulation index (max − min)/(max + min) over the frames, of the mean of the picture over black, and the
    largest one of 8 × 8 regions of it; in the light of equal exposure, so that a controller adds none.

    A metric of IEEE P2020 (automotive image quality): Deegan, "LED flicker: root cause, impact and measurement for
    automotive imaging applications", Electronic Imaging 2018, AVM-146. None of a single frame, and in darkness.
    """
    means = np.stack([_means(one.frames) for one in timed])
    if len(timed) < 2:
        return {"flicker_modulation_index": None, "flicker_modulation_index_largest": None}
    seen = means.mean(axis=0) > DIMMEST * means.mean(axis=0).max()
    regions = [index for index in map(_modulation, means[:, seen].T) if index is not None]
    return {
        "flicker_modulation_index": _modulation(means.mean(axis=1)),
        "flicker_modulation_index_largest": max(regions, default=None),
    }


def _means(frames: Frames) -> Float64Array:
    """Mean of each region over black, over exposure time and gain, (R,)."""
    camera, digital = frames.camera, frames.digital[0]
    edges = [np.linspace(0, n, min(n, REGIONS) + 1).astype(int)[:-1] for n in digital.shape]
    ones = np.ones(digital.shape)
    sums, counts = (
        np.add.reduceat(np.add.reduceat(x, edges[0], axis=0), edges[1], axis=1)
        for x in (digital.astype(np.float64), ones)
    )
    over_black_dn = (sums / counts).ravel() - camera.black_level_dn
    unit = max(frames.first.exposure.time_s, TINY_S) * gain_dn_per_e(camera)
    return np.asarray(over_black_dn / unit)


def _modulation(means: Float64Array) -> float | None:
    """(max − min)/(max + min)."""
    high, low = float(means.max()), max(float(means.min()), 0.0)
    return (high - low) / (high + low) if high > 0 else None
