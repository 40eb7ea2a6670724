"""Sensor: one camera with its serial number, whose FPN maps and compiled chain are kept from call to call."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Exposure, InputError, Photons
from ..core.options import documents
from .camera import Camera
from .expose import Frames, PreparedExposure, prepared
from .options import ExposeOptions
from .run import StripWindows

FIXED = ("serial", "maps", "chain")
"""Options that belong to the sensor."""


class Sensor:
    """A camera, ready to expose: what :func:`expose` makes anew in each call is made once and kept.

    ::

        sensor = ms.Sensor(camera, serial=7)
        for photons in scenes:
            frames = sensor.expose(photons, exposure)

    The frames are those of ``ms.expose(photons, camera, exposure, serial=7)``, byte for byte. One set of FPN maps is
    kept for each shape, origin, backend and precision that was asked for, the last ones up to ``most_bytes``.

    camera : a :class:`Camera`.  serial : its serial number, the seed of its fixed-pattern noise.
    maps : measured FPN maps in place of the serial number's own, as of :func:`expose`.
    most_bytes : memory for maps [byte]; what was used least recently is dropped beyond it.
    Raises InputError where :func:`expose` does.
    """

    def __init__(
        self, camera: Camera, *, serial: int = 1, maps: dict[str, ArrayLike] | None = None, most_bytes: float = 2**30
    ) -> None:
        self.camera, self.serial, self.maps, self.most_bytes = camera, serial, maps, most_bytes
        self._kept: dict[Any, StripWindows] = {}

    def __repr__(self) -> str:
        return f"Sensor({self.camera.name!r}, serial={self.serial}, {self.bytes / 2**20:.0f} MiB of FPN maps)"

    @property
    def bytes(self) -> int:
        """Memory of the FPN maps that are kept [byte]."""
        return sum(strips.bytes for strips in self._kept.values())

    def clear(self) -> None:
        """Forget all FPN maps; the next call makes them again."""
        self._kept.clear()

    @documents(ExposeOptions)
    def expose(self, photons: Photons | ArrayLike, exposure: Exposure, **options: Unpack[ExposeOptions]) -> Frames:
        """Raw frames of these mean photons per pixel, as of :func:`expose`."""
        frames = self._prepared(photons, exposure, options).frames()
        self._drop()
        return frames

    @documents(ExposeOptions)
    def stream(
        self, photons: Photons | ArrayLike, exposure: Exposure, **options: Unpack[ExposeOptions]
    ) -> Iterator[NDArray[np.unsignedinteger]]:
        """The frames one at a time, as of :func:`stream`."""
        return self._prepared(photons, exposure, options).stream()

    def _prepared(self, photons: Any, exposure: Exposure, options: ExposeOptions) -> PreparedExposure:
        for name in FIXED:
            if name in options:
                raise InputError(f"{name} belongs to the sensor; pass it to Sensor(camera, …), or use expose.")
        given: ExposeOptions = {**options, "serial": self.serial, "maps": self.maps}
        made = prepared(photons, self.camera, exposure, given)
        window = made.first.window
        backend = window.backend
        key = (window.shape, window.origin, type(backend), backend.precision, backend.bytes_of_numpy)
        strips = self._kept.pop(key, None) or StripWindows(window)
        self._kept[key] = strips  # the last one is the one that was used last
        return replace(made, first=replace(made.first, window=strips.window, _blocks={}), strips=strips)

    def _drop(self) -> None:
        while len(self._kept) > 1 and self.bytes > self.most_bytes:
            del self._kept[next(iter(self._kept))]
