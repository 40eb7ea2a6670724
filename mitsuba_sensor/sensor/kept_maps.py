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
RECENT_CAMERAS = 16


@dataclass(eq=False)
class KeptMaps:
    """Sets of FPN maps, each for one shape, origin, backend and precision; the one used least recently goes first.

    most_bytes : memory of all sets [byte].  fewest : sets that are kept whatever their size.
    """

    most_bytes: float
    fewest: int = 1
    _sets: dict[Hashable, StripWindows] = field(default_factory=dict)

    @property
    def bytes(self) -> int:
        """Memory of all sets [byte]."""
        return sum(strips.bytes for strips in self._sets.values())

    def clear(self) -> None:
        """Forget all sets."""
        self._sets.clear()

    def lend(self, prepared: PreparedExposure, chip: Hashable = None) -> PreparedExposure:
        """The same exposure with the maps of its window that were kept, or with an empty set that it fills.

        chip : what the maps depend on beside the window.
        """
        window = prepared.first.window
        backend = window.backend
        precision = type(backend), backend.precision, backend.bytes_of_numpy
        key = (chip, window.shape, window.origin, precision)
        strips = self._sets.pop(key, None)
        if strips is None:
            strips = StripWindows(window, strips_of(prepared.stages, window))
        self._sets[key] = strips  # at the end: the one that was used last
        first = replace(prepared.first, window=strips.window, _blocks={})
        return replace(prepared, first=first, strips=strips)

    def drop(self) -> None:
        """Forget the sets that were used least recently, until the others fit."""
        while len(self._sets) > self.fewest and self.bytes > self.most_bytes:
            del self._sets[next(iter(self._sets))]


class RecentMaps:
    """Maps of the chips that calls without a sensor of their own had last.

    A chip that comes once costs no memory: its maps are kept from the second call on. Given maps, and cameras with
    stages of a user's own, are not kept: nobody knows what the values of such a stage depend on.
    """

    def __init__(self, most_bytes: float = RECENT_BYTES) -> None:
        self._maps = KeptMaps(most_bytes, fewest=0)
        self._chips: dict[Hashable, Camera] = {}  # holds the cameras, or another gets their id
        self._lock = threading.Lock()

    def lend(self, prepared: PreparedExposure, camera: Camera) -> PreparedExposure:
        """The same exposure, with maps of earlier calls where this chip came before.

        camera : as it was asked for, whatever its gain setting.
        """
        window = prepared.first.window
        if camera.added or window.given:
            return prepared
        chip = id(camera), window.serial
        with self._lock:
            known = self._chips.pop(chip, None) is not None
            self._chips[chip] = camera
            if len(self._chips) > RECENT_CAMERAS:
                del self._chips[next(iter(self._chips))]
            if known:
                return self._maps.lend(prepared, chip)
            return prepared

    def drop(self) -> None:
        """Forget what was used least recently, until the rest fits."""
        with self._lock:
            self._maps.drop()

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._maps.clear()
            self._chips.clear()
