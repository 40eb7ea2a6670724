"""FPN maps that are kept from call to call: the sets that were used last, up to so many bytes."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from dataclasses import dataclass, field, replace

from ..camera.camera import Camera
from .expose import PreparedExposure
from .run import StripWindows, strips_of

RECENT_BYTES = 2**28
"""Memory of the maps that calls without a sensor of their own share [byte]."""
RECENT_SETS = 16
"""Cameras and windows that such calls remember."""


@dataclass(eq=False)
class KeptSet:
    """FPN maps of one camera and window.  maps : None until a second call asks for them."""

    camera: Camera
    window: Hashable
    maps: StripWindows | None = None


@dataclass(eq=False)
class KeptMaps:
    """Sets of FPN maps, found by the values of camera and window; the set used least recently goes first.

    most_bytes : memory of all sets [byte].
    guaranteed : whether maps are kept from the first call on, the last set whatever its size. Otherwise they are kept
        from the second call on, so that a camera or a serial number that comes once takes no memory.
    """

    most_bytes: float
    guaranteed: bool = True
    _sets: list[KeptSet] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def bytes(self) -> int:
        """Memory of all sets [byte]."""
        return sum(one.maps.bytes for one in self._sets if one.maps is not None)

    def clear(self) -> None:
        """Forget all sets."""
        with self._lock:
            self._sets.clear()

    def lend(self, prepared: PreparedExposure) -> PreparedExposure:
        """The same exposure with the maps that were kept of its camera and window, or with a set that it fills."""
        camera, window, backend = (
            prepared.camera,
            prepared.first.window,
            prepared.first.window.backend,
        )
        precision = type(backend), backend.precision, backend.bytes_of_numpy
        reach_px = sum(
            stage.reach_px for stage in prepared.stages
        )  # less where a plan leaves stages out
        key = window.serial, window.shape, window.origin, precision, reach_px
        with self._lock:
            own = next((x for x in self._sets if x.window == key and x.camera == camera), None)
            if own is None:
                own, keeps = KeptSet(camera, key), self.guaranteed
            else:
                self._sets.remove(own)
                keeps = True
            self._sets.append(own)  # at the end: the set that was used last
            if not keeps:
                return prepared
            own.maps = own.maps or StripWindows(window, strips_of(prepared.stages, window))
            first = replace(prepared.first, window=own.maps.window, _blocks={})
            return replace(prepared, first=first, strips=own.maps)

    def drop(self) -> None:
        """Forget the sets that were used least recently, until the others fit."""
        with self._lock:
            while self.bytes > self.most_bytes and len(self._sets) > self.guaranteed:
                del self._sets[0]
            if not self.guaranteed:
                del self._sets[:-RECENT_SETS]


def depends_on_camera_alone(prepared: PreparedExposure) -> bool:
    """Return False for given maps, and for stages of a user's own: their values may change from call to call."""
    return not (prepared.camera.added or prepared.first.window.given)
