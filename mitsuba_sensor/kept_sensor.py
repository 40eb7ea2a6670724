"""Sensor: one camera with its serial number, whose FPN maps and compiled chain are kept from call to call."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .camera.camera_file import AnyCamera, camera_of
from .core import Exposure, InputError, Photons, check_types, require, require_seed, warn_of
from .core.options import documents
from .expose import in_time, prepare_light, told_frames
from .output.frames import Frames
from .render.light.irradiance import Irradiance
from .sensor.expose import PreparedExposure
from .sensor.kept_maps import KeptMaps
from .sensor.options import ExposeOptions

FIXED = ("serial", "maps")
"""Options that belong to the sensor."""

COUNTING = threading.Lock()
"""Held while frames are numbered, so that threads which share a sensor never take the same one."""


class Sensor:
    """A camera, ready to expose: what :func:`expose` makes anew in each call is made once and kept.

    ::

        sensor = ms.Sensor(camera, serial=7)
        for photons in scenes:
            frames = sensor.expose(photons, exposure)

    A sensor counts its frames: a call without ``first_frame`` goes on behind all frames taken before, so that no two
    frames share their temporal noise. They are those of
    ``ms.expose(photons, camera, exposure, serial=7, first_frame=n)``, byte for byte, where n was
    ``sensor.frames_taken``. Set that to 0, or pass ``first_frame``, to take the same frames again.

    One set of FPN maps is kept for each shape, origin, backend and precision that was asked for, the last ones up to
    ``most_bytes``.

    camera : a :class:`Camera`.  serial : its serial number, which selects its fixed-pattern noise.
    maps : measured FPN maps in place of the serial number's own, as of :func:`expose`.
    most_bytes : memory for maps [byte]; what was used least recently is dropped beyond it.
    frames_taken : number of the frame behind the last one taken so far; it can be set.
    Raises InputError where :func:`expose` does.
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
        """Forget all FPN maps; the next call makes them again. The count of the frames goes on."""
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
        """Raw frames of these mean photons per pixel, as of :func:`expose`; by default those behind the last ones."""
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
        """What :meth:`expose` returns, without a warning."""
        made, before = self._counted(photons, exposure, options)
        try:
            with told_frames(made, "Sensor.expose", progress) as sensor:
                return Frames.exposed(sensor)
        except Exception:
            with (
                COUNTING
            ):  # what was not taken has no number, unless another thread has gone on from it
                if self.frames_taken == made.first.index + made.count:
                    self.frames_taken = before
            raise
        finally:
            with COUNTING:
                self._kept.drop()

    @documents(ExposeOptions)
    def stream(
        self,
        photons: Photons | ArrayLike | Irradiance,
        exposure: Exposure,
        **options: Unpack[ExposeOptions],
    ) -> Iterator[NDArray[np.unsignedinteger]]:
        """The frames one at a time, as of :func:`stream`; all of them count as taken from now on."""
        made = self._counted(photons, exposure, options)[0]
        frames = made.stream()
        warn_of(made.notes)
        return frames

    def _counted(
        self, photons: Any, exposure: Exposure, options: ExposeOptions
    ) -> tuple[PreparedExposure, int]:
        """Ready to take the next frames, which nobody else takes from now on, and ``frames_taken`` before these."""
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
                    f"{name} belongs to the sensor; pass it to Sensor(camera, …), or use expose."
                )
        begin: ExposeOptions = {"first_frame": self.frames_taken}
        given: ExposeOptions = {**begin, **options, "serial": self.serial, "maps": self.maps}
        prepared = prepare_light(photons, self.camera, exposure, given)
        if in_time(prepared, photons, given):
            raise InputError(
                "a Sensor has one light for all frames of a call, and this one flickers; expose them one by one, or "
                "use ms.expose."
            )
        return self._kept.lend(prepared)
