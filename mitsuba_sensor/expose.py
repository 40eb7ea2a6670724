"""Raw frames of mean photons, or of the irradiance of a render: expose(), stream() and Sensor."""

from __future__ import annotations

import atexit
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .camera.camera import Camera
from .camera.camera_file import AnyCamera, camera_of
from .core import (
    Exposure,
    InputError,
    Photons,
    check_types,
    checks_names,
    require,
    require_seed,
    warn_of,
)
from .core.checks import LIGHT_FILE, refuse_path
from .core.options import complete, documents
from .core.progress import automatic_progress, is_asked
from .output.frames import Frames
from .render.light.irradiance import Irradiance
from .render.light.photons import collected
from .sensor.expose import PreparedExposure, placed_photons
from .sensor.frame_times import FrameTimes
from .sensor.kept_maps import RECENT_BYTES, KeptMaps, depends_on_camera_alone
from .sensor.metering import AskedExposure
from .sensor.options import ExposeOptions
from .theory.plan import prepare_planned_exposure
from .timed_frames import TimedFrame, frames_in_time, joined

RECENT = KeptMaps(RECENT_BYTES, guaranteed=False)
"""FPN maps of the last cameras of :func:`expose`."""
FIXED = ("serial", "maps")
"""Options that belong to a :class:`Sensor`."""
COUNTING = threading.Lock()
"""Held while frames are numbered, so that threads with the same sensor never take the same number."""
atexit.register(RECENT.clear)  # before Dr.Jit ends, which owns some of them


@documents(ExposeOptions)
def expose(
    photons: Photons | ArrayLike | Irradiance,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    *,
    progress: bool | None = None,
    **options: Unpack[ExposeOptions],
) -> Frames:
    """Return the raw frames of ``camera`` for these mean photons per pixel.

    ::

        photons = np.full((48, 64), 20_000.0)
        frames = ms.expose(photons, "konnik_table1", ms.Exposure(0.01), frames=2)
        frames.digital.shape  # (2, 48, 64)

    photons : the result of :func:`collect`, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B. Or an Irradiance, which is collected: then camera, exposure and serial number
        are by default those that it was rendered for, and the exposure may be "auto" (metered).
    progress : None reports on stderr every ten seconds; False is silent.
    Notes on probable mistakes are given as SensorWarning and in the frames' ``notes``.
    Raises InputError for NaN or negative photons, with their number and the position of the first.
    """
    chosen = complete(ExposeOptions, options)
    prepared = prepare_light(photons, camera_of(camera), exposure, chosen)
    if depends_on_camera_alone(prepared):
        prepared = RECENT.lend(prepared)
    try:
        with told_frames(prepared, "expose", progress) as sensor:
            if series := in_time(sensor, photons, chosen):
                frames, _ = joined(series)
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
    """Yield the exposure, which reports progress for several frames.  name : of the function that the user called."""
    if not is_asked(progress) or sensor.count == 1:
        yield sensor
        return
    with automatic_progress(name, f"exposing {sensor.count} frames", thread=False) as teller:

        def told(done: int) -> None:
            if teller is not None:
                teller.tell(f"{done} of {sensor.count} frames", done / sensor.count)
                teller.tick()

        yield replace(sensor, told=told)


@documents(ExposeOptions)
def stream(
    photons: Photons | ArrayLike | Irradiance,
    camera: AnyCamera | None = None,
    exposure: AskedExposure | None = None,
    **options: Unpack[ExposeOptions],
) -> Iterator[NDArray[np.unsignedinteger]]:
    """Yield the frames of :func:`expose` one at a time, each (H, W) [DN], for more frames than memory holds.

    ::

        for number, frame in enumerate(ms.stream(photons, camera, exposure, frames=3)):
            print(number, frame.mean())

    Arguments are checked at once; light and maps are computed with the first frame.
    """
    chosen = complete(ExposeOptions, options)
    sensor = prepare_light(photons, camera_of(camera), exposure, chosen)
    frames = sensor.stream()
    warn_of(sensor.notes)
    if series := in_time(sensor, photons, chosen):
        return (one.frames.digital[0] for one in series)
    return frames


def in_time(
    sensor: PreparedExposure, light: object, options: ExposeOptions
) -> Iterator[TimedFrame] | None:
    """Return the frames of flickering lamps, each in the light of its time; None for other light or a single frame."""
    several = sensor.count > 1 or sensor.camera.quantum_efficiency.image_lag > 0
    if not several or FrameTimes.of(options).period_s is None:
        return None
    if not isinstance(light, Irradiance) or not light.waveforms:
        return None
    return frames_in_time(sensor, lambda *frame: light, options)


def prepare_light(
    light: Photons | ArrayLike | Irradiance,
    camera: Camera | None,
    exposure: AskedExposure | None,
    options: ExposeOptions,
) -> PreparedExposure:
    """Return an exposure with its light, collected if it is an Irradiance. Raises InputError.

    options : completed.
    """
    refuse_path("photons", light, LIGHT_FILE)
    times = FrameTimes.of(options)
    if isinstance(light, Irradiance):
        asked = options["serial"], options["gain"], times.of_frame(options["first_frame"])
        light, camera, exposure, serial = collected(light, camera, exposure, *asked)
        options = {**options, "serial": serial}
    check_types(camera, exposure)
    assert camera is not None and isinstance(exposure, Exposure)
    times.check(exposure, camera)
    photons = placed_photons(light, camera, options)
    sensor = prepare_planned_exposure(
        camera, exposure, photons.shape[:2], photons.origin, options
    )
    return sensor.of(photons)


@checks_names
class Sensor:
    """A camera that keeps what :func:`expose` computes in each call.

    ::

        sensor = ms.Sensor(camera, serial=7)
        for photons in scenes:
            frames = sensor.expose(photons, exposure)

    A sensor numbers its frames: a call without ``first_frame`` continues after all frames taken before, so no two
    frames have the same temporal noise. Frames are equal to those of
    ``ms.expose(photons, camera, exposure, serial=7, first_frame=n)``, n being ``sensor.frames_taken`` before. Set that
    to 0, or pass ``first_frame``, to take the same frames again.

    The sensor keeps FPN maps for each shape, origin, backend and precision, the last used up to ``most_bytes``.

    camera : a :class:`Camera`.  serial : its serial number, which selects its fixed-pattern noise.
    maps : measured FPN maps instead of those of the serial number, as in :func:`expose`.
    most_bytes : memory for maps [byte]; the least recently used are dropped beyond it.
    frames_taken : number of the next frame; it can be set.
    Raises InputError as :func:`expose` does.
    """

    def __init__(
        self,
        camera: AnyCamera,
        *,
        serial: int = 1,
        maps: dict[str, ArrayLike] | None = None,
        most_bytes: float = 2**30,
    ) -> None:
        self.camera, self.serial, self.maps = camera_of(camera), serial, maps
        require_seed("serial", serial)
        check_types(self.camera, None, optional=True)
        most = require("most_bytes", most_bytes, 0.0, math.inf, "bytes, e.g. 2**30")
        self.frames_taken = 0
        self._kept = KeptMaps(most)

    def __repr__(self) -> str:
        kept = f"{self.frames_taken} frames taken, {self.bytes / 2**20:.0f} MiB of FPN maps"
        return f"Sensor({self.camera.name!r}, serial={self.serial}, {kept})"

    @property
    def bytes(self) -> int:
        """Memory of the FPN maps that are kept [byte]."""
        return self._kept.bytes

    def clear(self) -> None:
        """Drop all FPN maps; the next call makes them again. The numbering of frames continues."""
        self._kept.clear()

    @documents(ExposeOptions)
    def expose(
        self,
        photons: Photons | ArrayLike | Irradiance,
        exposure: Exposure,
        *,
        progress: bool | None = None,
        **options: Unpack[ExposeOptions],
    ) -> Frames:
        """Return raw frames as :func:`expose`, by default the next ones."""
        frames = self.frames(photons, exposure, options, progress)
        warn_of(frames.exposure_notes)
        return frames

    def frames(
        self,
        photons: Photons | ArrayLike | Irradiance,
        exposure: Exposure,
        options: ExposeOptions,
        progress: bool | None = False,
    ) -> Frames:
        """Return the frames of :meth:`expose`, without a warning."""
        made, before = self._counted(photons, exposure, options)
        try:
            with told_frames(made, "Sensor.expose", progress) as sensor:
                return Frames.exposed(sensor)
        except Exception:
            with COUNTING:  # give the numbers back, unless another thread has continued
                if self.frames_taken == made.first.index + made.count:
                    self.frames_taken = before
            raise
        finally:
            self._kept.drop()

    @documents(ExposeOptions)
    def stream(
        self,
        photons: Photons | ArrayLike | Irradiance,
        exposure: Exposure,
        **options: Unpack[ExposeOptions],
    ) -> Iterator[NDArray[np.unsignedinteger]]:
        """Yield the frames one at a time as :func:`stream`; all of them count as taken at once."""
        made = self._counted(photons, exposure, options)[0]
        frames = made.stream()
        warn_of(made.notes)
        return frames

    def _counted(
        self, photons: Any, exposure: Exposure, options: ExposeOptions
    ) -> tuple[PreparedExposure, int]:
        """Return the exposure of the next frames, which are now reserved, and ``frames_taken`` before them."""
        with COUNTING:
            made, before = self._prepared(photons, exposure, options), self.frames_taken
            self.frames_taken = max(before, made.first.index + made.count)
        return made, before

    def _prepared(
        self, photons: Any, exposure: Exposure, options: ExposeOptions
    ) -> PreparedExposure:
        for name in FIXED:
            if name in options:
                raise InputError(
                    f"{name} is fixed for a Sensor; pass it to Sensor(camera, …), or use expose."
                )
        begin: ExposeOptions = {"first_frame": self.frames_taken}
        own: ExposeOptions = {**begin, **options, "serial": self.serial, "maps": self.maps}
        given = complete(ExposeOptions, own)
        prepared = prepare_light(photons, self.camera, exposure, given)
        if in_time(prepared, photons, given):
            raise InputError(
                "a Sensor has the same light for all frames of a call, but this light flickers; expose them one by "
                "one, or use ms.expose."
            )
        return self._kept.lend(prepared)
