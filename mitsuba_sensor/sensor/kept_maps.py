"""FPN maps that are kept from call to call: the most recent sets, up to a limit of memory."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from dataclasses import dataclass, field, replace

from ..camera.camera import Camera
from .expose import PreparedExposure
from .run import StripWindows, strips_of

RECENT_BYTES = 2**28
"""Memory for the maps that all calls of expose() share [byte]."""
RECENT_SETS = 16
"""Number of cameras and windows that these calls remember."""


@dataclass(eq=False)
class KeptSet:
    """FPN maps of one camera and window.  maps : None until a second call needs them."""

    camera: Camera
    window: Hashable
    maps: StripWindows | None = None


@dataclass(eq=False)
class KeptMaps:
    """Sets of FPN maps by camera and window; the least recently used set is dropped first.

    most_bytes : memory for all sets [byte].
    guaranteed : True keeps maps from the first call on, and the last set whatever its size. False keeps maps from the
        second call on, so a camera or serial number that is used once takes no memory.
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
        """Drop all sets."""
        with self._lock:
            self._sets.clear()

    def lend(self, prepared: PreparedExposure) -> PreparedExposure:
        """Return the exposure with the kept maps of its camera and window, or with an empty set that it fills."""
        camera, window, backend = (
            prepared.camera,
            prepared.first.window,
            prepared.first.window.backend,
        )
        precision = type(backend), backend.precision, backend.bytes_of_numpy
        reach_px = sum(
            stage.reach_px for stage in prepared.stages
        )  # smaller if a plan leaves stages out
        key = window.serial, window.shape, window.origin, precision, reach_px
        with self._lock:
            own = next((x for x in self._sets if x.window == key and x.camera == camera), None)
            if own is None:
                own, keeps = KeptSet(camera, key), self.guaranteed
            else:
                self._sets.remove(own)
                keeps = True
            self._sets.append(own)  # last: used most recently
            if not keeps:
                return prepared
            own.maps = own.maps or StripWindows(window, strips_of(prepared.stages, window))
            first = replace(prepared.first, window=own.maps.window, _blocks={})
            return replace(prepared, first=first, strips=own.maps)

    def drop(self) -> None:
        """Drop the least recently used sets until the other sets fit."""
        with self._lock:
            while self.bytes > self.most_bytes and len(self._sets) > self.guaranteed:
                del self._sets[0]
            if not self.guaranteed:
                del self._sets[:-RECENT_SETS]


def depends_on_camera_alone(prepared: PreparedExposure) -> bool:
    """Return True if no map or stage of a user, whose values may change from call to call, affects the maps."""
    return not (prepared.camera.added or prepared.first.window.given)
