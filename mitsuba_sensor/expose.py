"""Light in, raw frames out: expose() and stream(), of mean photons or of the irradiance of a render."""

from __future__ import annotations

import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .camera.camera import Camera
from .camera.camera_file import AnyCamera, camera_of
from .core import Exposure, Photons, check_types, warn_of
from .core.checks import LIGHT_FILE, refuse_path
from .core.options import documents, refuse_unknown
from .core.progress import automatic_progress, is_asked
from .output.frames import Frames
from .render.light.irradiance import Irradiance
from .render.light.photons import collected
from .sensor.expose import PreparedExposure, placed_photons
from .sensor.frame_times import FrameTimes
from .sensor.kept_maps import RecentMaps
from .sensor.metering import AskedExposure
from .sensor.options import ExposeOptions
from .theory.plan import prepare_planned_exposure
from .timed_frames import TimedFrame, joined, timed_exposure

RECENT = RecentMaps()
"""FPN maps of the cameras that :func:`expose` had last."""
atexit.register(RECENT.clear)  # before Dr.Jit, which owns some of them, is gone


@documents(ExposeOptions)
def expose(
    photons: Photons | ArrayLike | Irradiance,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    *,
    progress: bool | None = None,
    **options: Unpack[ExposeOptions],
) -> Frames:
    """Raw frames that ``camera`` delivers for these mean photons per pixel.

    ::

        photons = np.full((48, 64), 20_000.0)
        frames = ms.expose(photons, "konnik_table1", ms.Exposure(0.01), frames=2)
        frames.digital.shape  # (2, 48, 64)

    photons : what :func:`collect` returns, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B. Or the Irradiance itself, which is collected: then camera, exposure and serial
        number are by default those that it was rendered for, and the exposure may be "auto" (metered).
    progress : None says every ten seconds on stderr how many frames are done, in a notebook by a bar; False does not.
    A SensorWarning says where the result is probably not the one that was wanted; the frames' ``notes`` say it too.
    Raises InputError for NaN or negative photons, naming how many there are and where the first one is.
    """
    given = camera_of(camera)
    prepared = prepare_light(photons, given, exposure, options)
    asked = _asked_camera(photons, given)
    lent = RECENT.lend(prepared, asked)
    try:
        with told_frames(lent, "expose", progress) as sensor:
            if series := in_time(sensor, photons, options):
                frames = joined(series).frames
            else:
                frames = Frames.exposed(sensor)
    finally:
        RECENT.drop()
    warn_of(frames.exposure_notes)
    return frames


@contextmanager
def told_frames(
    sensor: PreparedExposure, name: str, progress: bool | None
) -> Iterator[PreparedExposure]:
    """The exposure; of several frames it says how many are done.  name : of the function that the user called."""
    if not is_asked(progress) or sensor.count == 1:
        yield sensor
        return
    with automatic_progress(name, f"exposing {sensor.count} frames", thread=False) as teller:

        def told(done: int) -> None:
            if teller is not None:
                teller.tell(f"{done} of {sensor.count} frames", done / sensor.count)
                teller.tick()

        yield replace(sensor, told=told)


def _asked_camera(photons: Photons | ArrayLike | Irradiance, camera: Camera | None) -> Camera:
    """The camera that was given, or that of the render; not yet at a gain setting."""
    if camera is None:
        assert isinstance(photons, Irradiance) and photons.rendered_for is not None
        camera = photons.rendered_for.camera
    assert camera is not None
    return camera


@documents(ExposeOptions)
def stream(
    photons: Photons | ArrayLike | Irradiance,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    **options: Unpack[ExposeOptions],
) -> Iterator[NDArray[np.unsignedinteger]]:
    """The frames of :func:`expose` one at a time, each (H, W) [DN]: for more of them than memory holds.

    ::

        for number, frame in enumerate(ms.stream(photons, camera, exposure, frames=3)):
            print(number, frame.mean())

    Everything is checked at once; light and maps are made with the first frame that is asked for.
    """
    sensor = prepare_light(photons, camera_of(camera), exposure, options)
    frames = sensor.stream()
    warn_of(sensor.notes)
    if series := in_time(sensor, photons, options):
        return (one.frames.digital[0] for one in series)
    return frames


def in_time(
    sensor: PreparedExposure, light: object, options: ExposeOptions
) -> Iterator[TimedFrame] | None:
    """Frames of lamps that flicker, each in the light of its time; None of others, and of one that shows no other."""
    several = sensor.count > 1 or sensor.camera.quantum_efficiency.image_lag > 0
    if not several or FrameTimes.of(options).period_s is None:
        return None
    if not isinstance(light, Irradiance) or not light.waveforms:
        return None
    return timed_exposure(sensor, lambda *frame: light, options).each()


def prepare_light(
    light: Photons | ArrayLike | Irradiance,
    camera: Camera | None,
    exposure: AskedExposure | None,
    options: ExposeOptions,
) -> PreparedExposure:
    """An exposure with its light, which is collected where it is the irradiance of a render. Raises InputError."""
    refuse_unknown(options, ExposeOptions)
    refuse_path("photons", light, LIGHT_FILE)
    if isinstance(light, Irradiance):
        begin_s = FrameTimes.of(options).of_frame(options.get("first_frame") or 0)
        asked = options.get("serial"), options.get("gain"), begin_s
        light, camera, exposure, serial = collected(light, camera, exposure, *asked)
        options = {**options, "serial": serial}
    check_types(camera, exposure)
    assert camera is not None and isinstance(exposure, Exposure)
    FrameTimes.of(options).check(exposure, camera)
    photons = placed_photons(light, camera, options)
    sensor = prepare_planned_exposure(
        camera, exposure, photons.shape[:2], photons.origin, options
    )
    return sensor.of(photons)
