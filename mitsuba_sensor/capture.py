"""Raw frames of a scene, or of rendered light, and their files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any, NamedTuple, Unpack, cast

from .camera.camera import Camera
from .camera.camera_file import AnyCamera, camera_of
from .capture_options import CaptureOptions, check_asked_files
from .core import Exposure, InputError, Photons, warn_of
from .core.heap import trim_heap
from .core.options import complete, documents, used
from .exposed import (
    Exposed,
    Light,
    Request,
    Scene,
    expose_light,
    render_each_frame,
    render_once,
    timed,
)
from .files import tiff
from .files.appearing import output_folder, output_folders
from .files.openexr import is_exr
from .files.sensor_names import ALL_SENSORS
from .output import exr
from .output.dng import dng_names, write_dng
from .output.frame_files import (
    CAPTURE_FILES,
    CLEAN,
    FRAME_FILES,
    PAGE,
    frames_metadata,
    write_frames,
)
from .output.frames import Frames, notes_after_render
from .render.light.irradiance import Irradiance
from .render.light.light_source import CollectedLight
from .render.motion.aovs import Aovs
from .render.passes.stop_criterion import Progress, told_progress
from .render.scene.parse_scene import SceneInput, parse_sensors, refuse_one_place
from .render.scene.parsed_scene import ParsedScene
from .render.variants import restores_variant
from .sensor.frame_times import FrameTimes
from .sensor.metering import AskedExposure, Metering, checked_exposure
from .timed_frames import TimedFrame, series_facts, write_video


@dataclass(frozen=True, eq=False, repr=False)
class Capture:
    """Frames of a camera, with their light and metadata.

    ::

        captured = ms.capture("out/irradiance.exr", frames=4)
        print(captured.frames.digital.mean(), captured.metadata["seeds"])

    frames : the raw frames, ``frames.digital`` (N, H, W) [DN].
    light, photons : irradiance at the focal plane with its ``lights``, and mean photons per pixel, of the first frame.
    aovs : depth, normals, … of the same pixels, if asked for.
    timed : the frames one by one, if they follow each other in time (``fps``).
    metadata : contents of frame.json: camera, exposure, options, seeds, theory and frame, render statistics.
    sensors : with ``sensor="all"`` the capture of each sensor by its name, this one first; else empty.
    """

    frames: Frames
    light: Irradiance
    photons: Photons
    aovs: Aovs | None
    metadata: dict[str, Any]
    rendered: bool
    timed: tuple[TimedFrame, ...] = ()
    sensors: Mapping[str, Capture] = field(default_factory=dict)

    def __repr__(self) -> str:
        count = len(self.notes)
        notes = f", {count} note{'s' * (count > 1)}: .notes" if count else ""
        return f"<Capture: {self.frames!r}, {self.light!r}{notes}>"

    def _repr_html_(self) -> str:
        parts = [("", self)] if not self.sensors else self.sensors.items()
        return "".join(
            f"{f'<p>{escape(name)}</p>' if name else ''}{one.frames._repr_html_()}{one.light._repr_html_()}"
            for name, one in parts
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the light and exposure of the first frame, as the command line prints them."""
        return tuple(self.metadata["notes"])

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write frame.tiff, frame.png, frame.json, irradiance.exr if rendered, and other files asked for.

        Several sensors get a folder each. Either all files appear or none; other files of an older capture are
        removed. Raises InputError.
        """
        if self.sensors:
            with output_folders(folder, self.sensors, CAPTURE_FILES) as folders:
                for name, one in self.sensors.items():
                    one.write(folders[name])
            return
        names = CAPTURE_FILES if self.rendered else FRAME_FILES
        with output_folder(os.fspath(folder), names) as scratch:
            self.write(scratch)

    def write(self, folder: Path) -> None:
        """Write these files into an empty folder."""
        options, metadata = self.metadata["options"], self.metadata
        gain = float(options["preview_gain"])
        if options["clean"]:
            metadata = metadata | {"clean_by": self.frames.pixel_moments.method}
        write_frames(folder, self.frames, metadata, gain)
        if options["clean"]:
            each, shared = self.frames.own_clean, self.frames.clean
            clean_name, variance_name = CLEAN
            tiff.write_tiff(folder / clean_name, shared if each is None else each)
            tiff.write_tiff(folder / variance_name, self.frames.temporal_variance)
        if options["page"]:
            self.frames.save_page(folder / PAGE)
        if options["dng"]:
            for number, name in enumerate(dng_names(self.frames)):
                if self.timed:
                    write_dng(folder / name, self.timed[number].frames, 0)
                else:
                    write_dng(folder / name, self.frames, number)
        write_video(folder, self.timed, gain)
        if self.rendered and not options["no_irradiance"]:
            as_rendered = self.light if options["lights"] is None else self.light.with_lights()
            exr.write_irradiance_exr(folder / "irradiance.exr", as_rendered, options["half"])
        if self.aovs is not None:
            exr.write_aovs_exr(folder / "aovs.exr", self.aovs)


@documents(CaptureOptions)
@restores_variant
def capture(
    source: Scene | Light,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    *,
    progress: Progress | bool | None = None,
    **options: Unpack[CaptureOptions],
) -> Capture:
    """Render a scene and expose a camera to it; ``capture("scene.xml").save("out/")``.

    ::

        captured = ms.capture("cornell_box", "bayer_2mp", ms.Exposure(0.1), width=64)
        captured.save("out/")

    source : a scene (a file, or a name from ``mitsuba-sensor scenes list``), or rendered light: an irradiance.exr, or
        the result of :func:`render`.
    camera, exposure : default: those of the scene's <film type="photosensor">, or those that the light was rendered
        for, with their serial number; else konnik_table1 with a note, and a metered exposure ("auto").
    progress : None reports on stderr every ten seconds; False is silent; a function is called with a
        :class:`render.passes.stop_criterion.RenderProgress` after every pass and frame.
    With ``sensor="all"`` every sensor of the scene takes a frame at the same instant: ``captured.sensors["left"]``.
    Everything is checked before the first ray is traced. Raises InputError.
    """
    chosen, asked = camera_of(camera), complete(CaptureOptions, options)
    check_asked_files(asked)
    when = checked_exposure(chosen, exposure)
    with told_progress(progress, "capture", asked) as tell:
        if asked["sensor"] != ALL_SENSORS or _is_light(source):
            return _captured(Request(source, chosen, when, asked, tell))
        parsed = parse_sensors(cast(SceneInput, source), asked)
        return capture_sensors(
            {name: SensorView(one, chosen, when) for name, one in parsed.items()}, asked, tell
        )


class SensorView(NamedTuple):
    """A scene of one of its sensors, and the camera and exposure; None for those of the scene."""

    scene: ParsedScene
    camera: Camera | None
    exposure: Exposure | Metering | None


def capture_sensors(
    views: Mapping[str, SensorView], options: CaptureOptions, progress: Progress | None
) -> Capture:
    """Capture each sensor of a scene at the same instant. Raises InputError."""
    refuse_one_place(views, options["look_at"], options["motion"])
    if options["luminance"] is not None and len(views) > 1:
        raise InputError(
            f"luminance is {options['luminance']:g}, but each of {len(views)} sensors ({', '.join(views)}) would scale "
            "the light by its own picture; use one sensor, and multiply the emitters of the scene by its light_scale."
        )
    captures = dict[str, Capture]()
    for name, view in views.items():
        asked: CaptureOptions = {**options, "sensor": name}
        captures[name] = _captured(Request(*view, asked, progress))
    return replace(next(iter(captures.values())), sensors=captures)


def _is_light(source: Scene | Light) -> bool:
    """Return whether the source is rendered light."""
    is_file = isinstance(source, str | os.PathLike)
    return isinstance(source, Irradiance) or (is_file and is_exr(cast(str, source)))


def _captured(request: Request) -> Capture:
    """Return the capture of one sensor."""
    if _is_light(request.source):
        exposed = expose_light(request)
    elif request.options["render_noise"] == "shared":
        exposed = render_once(request)
    else:
        exposed = render_each_frame(request)
    frames, light, render = exposed.frames, exposed.light, exposed.render
    metadata = frame_metadata(exposed, request.times_s)
    aovs = None
    if render is not None and request.options["aovs"]:
        with timed(request.times_s, "aovs"):
            aovs = render.aovs()
    warn_of(frames.exposure_notes if render is None else notes_after_render(light, frames))
    rendered = render is not None
    return Capture(frames, light, frames.light, aovs, metadata, rendered, exposed.timed)


def frame_metadata(exposed: Exposed, times_s: dict[str, float]) -> dict[str, Any]:
    """Return the contents of frame.json.

    times_s : seconds by step, to which this step is added.
    """
    frames, light, options = exposed.frames, exposed.light, exposed.options
    with timed(times_s, "report"):
        statistics = light.statistics.to_dict()
        planned = {} if frames.plan is None else frames.plan.to_dict()
        noise, _ = frames.render_noise
        trim_heap()
        source = frames.light.source
        assert isinstance(source, CollectedLight)
        of_frames, band_error = frames_metadata(frames), source.band_error(frames.camera)
    bands = {
        "wavelengths_nm": light.wavelengths_nm,
        "bandwidths_nm": light.bandwidths_nm,
        **band_error._asdict(),
    }
    summary, notes = of_frames.pop("summary"), of_frames.pop("notes")
    return {
        "summary": summary,
        "notes": notes,
        "origin": {**exposed.origin, "scene_sha256": statistics["scene_sha256"]},
        "sensor": sensor_facts(exposed),
        **of_frames,
        "options": used(CaptureOptions, options),
        "series": series_facts(exposed.timed, options),
        "bands": bands,
        "counts": {
            **of_frames["counts"],
            **{name: statistics[name] for name in ("negative", "non_finite")},
        },
        "render": statistics,
        "render_noise": noise,
        "effects": planned.get("stages", []),
        "times_s": times_s,
    }


def sensor_facts(exposed: Exposed) -> dict[str, object] | None:
    """Return the sensor of the scene that took the frames; None for light that was rendered before.

    to_world : pose, 4×4 with lengths in metres, at the start of the first frame.  start_s : time of that start [s].
    """
    if exposed.render is None:
        return None
    sensor, times = exposed.render.parsed.sensor_taken(), FrameTimes.of(exposed.options)
    return {
        "name": sensor.name,
        "number": sensor.number,
        "to_world": exposed.light.statistics.camera_to_world,
        "start_s": times.of_frame(exposed.options["first_frame"]),
    }
