"""One exposure of one camera: time, temperature, and where its random words come from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import draws, words
from .errors import require, require_seed


@dataclass(frozen=True)
class Exposure:
    """How long the shutter is open, and how warm the sensor is.

    time_s : 0 or more, finite [s].  temperature_k : 0 or more [K]; 298.15 K (+25 °C) as in Konnik & Welsh 2014.
    Raises InputError otherwise.
    """

    time_s: float
    temperature_k: float = 298.15

    def __post_init__(self) -> None:
        require("exposure time_s", self.time_s, 0.0, math.nextafter(math.inf, 0), "seconds and finite, e.g. 0.1")
        require("temperature_k", self.temperature_k, 0.0, math.nextafter(math.inf, 0), "kelvin, e.g. 298.15 for 25 °C")


@dataclass(frozen=True, eq=False)
class Device:
    """A camera of one serial number seen through one window: it holds the patterns that never change.

    shape, origin : (rows, columns) of the window and its first pixel, in sensor coordinates.
    """

    serial: int
    shape: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    patterns: dict[Any, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_seed("serial", self.serial)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Row numbers of the window, in sensor coordinates."""
        return np.arange(self.origin[0], self.origin[0] + self.shape[0])

    @property
    def columns(self) -> NDArray[np.int64]:
        """Column numbers of the window, in sensor coordinates."""
        return np.arange(self.origin[1], self.origin[1] + self.shape[1])

    def pattern(self, source: str, law: Callable[[words.Words], Any]) -> Any:
        """The fixed pattern of ``source``, (H, W): ``law`` turns its words into values, once per camera."""
        key = (source, law)
        if key not in self.patterns:
            number, word = words.PLACES[source]
            self.patterns[key] = law(words.block(number, self.rows, self.columns, 0, self.serial)[word])
        return self.patterns[key]

    def line_pattern(self, source: str, coupling: float) -> Any:
        """The fixed offset of every column, (1, W), mean 0 and variance 1, neighbours coupled by ``coupling``."""
        key = (source, coupling)
        if key not in self.patterns:
            first, size = self.columns[0] // draws.AR_BLOCK, draws.AR_BLOCK
            last = self.columns[-1] // size
            line = np.concatenate([self._line_block(source, b, coupling) for b in range(first, last + 1)])
            self.patterns[key] = line[self.columns - first * size][None, :]
        return self.patterns[key]

    def _line_block(self, source: str, number: int, coupling: float) -> Any:
        """AR_BLOCK columns at a fixed place of the sensor, so that every window sees the same bits."""
        start, margin = number * draws.AR_BLOCK, draws.AR_WARM_UP
        columns = np.arange(start - margin, start + draws.AR_BLOCK + margin)
        place, word = words.PLACES[source]
        white = draws.normal(words.block(place, np.zeros(1, dtype=np.int64), columns, 0, self.serial)[word])[0]
        return draws.isotropic_ar(white, coupling)


@dataclass(frozen=True, eq=False)
class Frame:
    """Frame ``index`` of ``device`` under ``exposure``; ``seed`` is the seed of all temporal noise."""

    exposure: Exposure
    device: Device
    seed: int = 1
    index: int = 0
    _blocks: dict[int, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_seed("seed", self.seed)

    def words(self, source: str) -> words.Words:
        """The temporal words of ``source``, (H, W)."""
        number, word = words.PLACES[source]
        if number not in self._blocks:
            device = self.device
            self._blocks[number] = words.block(number, device.rows, device.columns, self.index, self.seed)
        return self._blocks[number][word]

    def normal(self, source: str) -> Any:
        """Standard normal noise of ``source``, new in every frame, (H, W)."""
        return draws.normal(self.words(source))

    def poisson(self, source: str, mean: Any) -> Any:
        """Poisson counts of ``source`` about ``mean`` (scalar or (H, W)), (H, W)."""
        return draws.poisson(self.words(source), mean)
