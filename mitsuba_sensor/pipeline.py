"""One straight function from scene to files, render → photons → frames, for Python and the command line."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, Unpack

import numpy as np

from .capture_options import CaptureOptions, refuse_render_options
from .core import Exposure, InputError, Photons, warn_of
from .core.heap import trim_heap
from .core.options import complete, documents, part_of, used
from .files import tiff
from .files.appearing import output_folder
from .files.openexr import is_exr
from .output import exr
from .output.dng import check_dng, dng_names, write_dng
from .output.frame_files import CAPTURE_FILES, CLEAN, FRAME_FILES, frames_metadata, write_frames
from .output.light_files import read_irradiance
from .render.denoise.network import denoised_if_possible
from .render.light.irradiance import Irradiance
from .render.light.light_source import CollectedLight
from .render.light.photons import collect
from .render.motion.aovs import Aovs
from .render.options import FrameSeriesOptions, RenderOptions
from .render.passes.per_frame import FrameSeries
from .render.passes.prepared import PreparedRender, prepare
from .render.passes.stop_criterion import Progress, RenderProgress
from .render.scene.scene_nodes import SceneInput
from .render.scene.scene_settings import ParsedScene
from .render.variants import restores_variant
from .sensor.camera import Camera
from .sensor.checks import as_photons
from .sensor.choices import KEEP, check_clean
from .sensor.expose import PreparedExposure, prepare_exposure
from .sensor.frames import Frames
from .sensor.metering import AskedExposure, Metering, checked_exposure
from .sensor.options import ExposeOptions

LEFT = ("uncompensated", "above_shot_noise")  # of renders for every frame: what their noise leaves in the frames
Scene: TypeAlias = SceneInput | ParsedScene
Light: TypeAlias = str | os.PathLike[str] | Irradiance
Asked: TypeAlias = tuple[Scene, Camera | None, Exposure | Metering | None]
Made: TypeAlias = tuple[PreparedRender, Irradiance, Frames, dict[str, float]]  # … and what is left uncompensated


@dataclass(frozen=True, eq=False, repr=False)
class Capture:
    """Frames of a camera, and what they were made from.

    frames : the raw frames, ``frames.digital`` (N, H, W) [DN].
    light, photons : irradiance at the focal plane, mean photons per pixel; of the first frame where each has its own.
    aovs : depth, normals, … of the same pixels, if asked for.
    metadata : what is written as frame.json: camera, exposure, options, seeds, theory beside frame, render statistics.
    """

    frames: Frames
    light: Irradiance
    photons: Photons
    aovs: Aovs | None
    metadata: dict[str, Any]
    rendered: bool

    def __repr__(self) -> str:
        return f"<Capture: {self.frames!r}, {self.light!r}>"

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write frame.tiff, frame.png, frame.json, irradiance.exr if it was rendered, and what else was asked for.

        All of them appear, or none; files of an older capture that this one does not have go. Raises InputError.
        """
        gain = float(self.metadata["options"]["preview_gain"])
        with output_folder(os.fspath(folder), CAPTURE_FILES if self.rendered else FRAME_FILES) as scratch:
            write_frames(scratch, self.frames, self.metadata, gain)
            if self.metadata["options"]["clean"]:
                for name, values in zip(CLEAN, (self.frames.clean, self.frames.temporal_variance), strict=True):
                    tiff.write_tiff(scratch / name, values)
            if self.metadata["options"]["dng"]:
                for number, name in enumerate(dng_names(self.frames)):
                    write_dng(scratch / name, self.frames, number)
            if self.rendered and not self.metadata["options"]["no_irradiance"]:
                exr.write_irradiance_exr(scratch / "irradiance.exr", self.light, self.metadata["options"]["half"])
            if self.aovs is not None:
                exr.write_aovs_exr(scratch / "aovs.exr", self.aovs)


@documents(CaptureOptions)
@restores_variant
def capture(
    source: Scene | Light,
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    *,
    progress: Progress | None = None,
    **options: Unpack[CaptureOptions],
) -> Capture:
    """Render a scene and expose a camera to it; ``capture("scene.xml").save("out/")``.

    source : a scene file, or light that is there already: an irradiance.exr, or what :func:`render` returned.
    camera, exposure : what is not given is read from the scene's <film type="photosensor">, or is what the light was
        rendered for, and so is its serial number; an exposure of "auto", or none anywhere, is metered.
    progress : called with a :class:`render.passes.stop_criterion.RenderProgress` after every pass and frame.
    Everything is checked before the first ray is traced. Raises InputError.
    """
    asked = checked_exposure(camera, exposure)
    chosen, times_s = complete(CaptureOptions, options), dict[str, float]()
    if chosen["clean"]:
        check_clean(chosen["chain"])
    if chosen["half"] and chosen["no_irradiance"]:
        raise InputError("half is the precision of irradiance.exr, which is not to be written; leave one of both out.")
    if isinstance(source, Irradiance) or (isinstance(source, str | os.PathLike) and is_exr(source)):
        refuse_render_options(chosen)
        return _of_light((source, camera, asked), chosen, progress, times_s)
    make = _shared_render if chosen["render_noise"] == "shared" else _render_per_frame
    prepared, light, frames, left = make((source, camera, asked), chosen, progress, times_s)
    origin = {
        "scene": prepared.parsed.file.path,
        "parameters": dict(chosen["parameters"] or {}),
        "motion": used(CaptureOptions, chosen)["motion"],
        "render_noise": chosen["render_noise"],
        "metering": light.statistics.metering,
        **left,
    }
    light = light.of_serial(frames.first.window.serial)
    metadata, aovs = frame_metadata(frames, light, chosen, origin, times_s), None
    if chosen["aovs"]:
        with _timed(times_s, "aovs"):
            aovs = prepared.aovs()
    warn_of((*light.notes, *frames._exposure_notes))
    return Capture(frames, light, frames.light, aovs, metadata, rendered=True)


@contextmanager
def _timed(times_s: dict[str, float], name: str) -> Iterator[None]:
    """Note the wall-clock seconds that the block takes, and give back the memory that it no longer needs."""
    start = time.perf_counter()
    yield
    trim_heap()
    times_s[name] = round(time.perf_counter() - start, 4)


def _of_light(
    wanted: tuple[Light, Camera | None, Exposure | Metering | None],
    options: CaptureOptions,
    progress: Progress | None,
    times_s: dict[str, float],
) -> Capture:
    """Frames of light that is rendered already."""
    source, camera, asked = wanted
    path = None if isinstance(source, Irradiance) else Path(source)
    with _timed(times_s, "read irradiance"):
        light = source if isinstance(source, Irradiance) else read_irradiance(source)
        light = light.before_denoising() if options["raw_light"] else light
    photons, camera, exposure, serial = light.collected(camera, asked, options["serial"], options["gain"])
    options, known = {**options, "serial": serial}, light.rendered_for
    metering = Metering() if asked is None and known is None else asked
    origin = {
        "irradiance": path,
        "as_rendered": [] if known is None else known.shared_with(camera, exposure, serial),
        "metering": metering.record(exposure) if isinstance(metering, Metering) else None,
    }
    sensor = prepare_exposure(camera, exposure, light.data.shape[:2], light.origin, part_of(ExposeOptions, options))
    _check_files(sensor, options)
    with _timed(times_s, "expose"):
        frames = _exposed(sensor.of(photons), progress)
    metadata = frame_metadata(frames, light, options, origin, times_s)
    warn_of(frames._exposure_notes)
    return Capture(frames, light, frames.light, None, metadata, rendered=False)


def _shared_render(asked: Asked, options: CaptureOptions, progress: Progress | None, times_s: dict[str, float]) -> Made:
    """One render, and all frames of it."""
    rendering = denoised_if_possible(part_of(RenderOptions, options))
    with _timed(times_s, "render"):
        started = time.monotonic()
        prepared = prepare(*asked, **rendering)
        if options["chain"] == "konnik2014" and len(prepared.bands) != 1:
            raise InputError("chain konnik2014 has one wavelength; give wavelength_nm, e.g. --wavelength-nm 550.")
        sensor = prepared.sensor(part_of(ExposeOptions, options))
        _check_files(sensor, options)  # checked before the first ray
        light = prepared.render(sensor.first.seed, prepared.stop_criterion(rendering), progress, started=started)
        prepared.renderer.release()
    with _timed(times_s, "expose"):
        exposure = prepared.exposure_of(light)
        photons = as_photons(collect(light, prepared.camera, exposure), prepared.camera)
        return prepared, light, _exposed(sensor.at(exposure).of(photons), progress), {}


def _check_files(sensor: PreparedExposure, options: CaptureOptions) -> None:
    """Raise InputError for frames of which a file is asked for that cannot hold them."""
    if options["dng"]:
        check_dng(sensor.camera, sensor.first.window.shape)


def _exposed(sensor: PreparedExposure, progress: Progress | None) -> Frames:
    """The frames, one report after each of them."""
    if progress is None:
        return sensor.frames_with_report()
    began, count = time.monotonic(), sensor.count

    def tell(done: int) -> None:
        seconds = time.monotonic() - began
        left_s = seconds / done * (count - done) if done else math.nan
        progress(RenderProgress(done, count, seconds=seconds, seconds_left=left_s, doing="exposing"))

    tell(0)
    return replace(sensor, told=tell).frames_with_report()


def _render_per_frame(
    asked: Asked, options: CaptureOptions, progress: Progress | None, times_s: dict[str, float]
) -> Made:
    """A render for every frame; irradiance and metadata are those of the first."""
    noise = options["render_noise"]
    assert noise != "shared"
    if options["chain"] != "physical":
        raise InputError(f"render_noise is {noise!r}, which is for the physical chain; leave the chain out.")
    with _timed(times_s, "render and expose"):
        series = FrameSeries.prepare(*asked, part_of(FrameSeriesOptions, options), noise)
        _check_files(series.sensor, options)
        found = list(series.frames(progress, report=True))
    first = found[0]
    names = ("digital", *(name for name in KEEP if getattr(first.frames, name) is not None))
    whole: dict[str, Any] = {name: np.concatenate([getattr(one.frames, name) for one in found]) for name in names}
    frames = replace(first.frames, **whole)
    vars(frames)["_observer"] = first.frames._observer
    if options["clean"]:
        vars(frames)["clean"] = np.concatenate([one.frames.clean for one in found])
    left = {name: float(np.mean([getattr(one, name) for one in found])) for name in LEFT}
    return series.prepared, first.light, frames, left


def frame_metadata(
    frames: Frames, light: Irradiance, options: CaptureOptions, origin: Mapping[str, object], times_s: dict[str, float]
) -> dict[str, Any]:
    """The whole of frame.json: what a frame was made of, and what theory says of it, stage by stage.

    origin : where the light comes from.  times_s : seconds by step, to which this one is added.
    """
    with _timed(times_s, "report"):
        statistics, camera = light.statistics.to_dict(), frames.camera
        planned = {} if frames.plan is None else frames.plan.to_dict()
        noise, _ = frames._render_noise
        trim_heap()
        source = frames.light.source
        assert isinstance(source, CollectedLight)
        known, off = frames_metadata(frames), source.band_error(camera)
    return {
        "origin": {**origin, "scene_sha256": statistics["scene_sha256"]},
        **known,
        "options": used(CaptureOptions, options),
        "chain": options["chain"],
        "bands": {"wavelengths_nm": light.wavelengths_nm, "bandwidths_nm": light.bandwidths_nm, **off._asdict()},
        "counts": {**known["counts"], **{name: statistics[name] for name in ("negative", "non_finite")}},
        "render": statistics,
        "render_noise": noise,
        "effects": planned.get("stages", []),
        "float32": planned.get("float32"),
        "times_s": times_s,
    }
