"""One exposure of one camera: time, temperature, and where its random words come from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import draws
from .errors import require, require_seed
from .words import PLACES, Words, block, philox

LONGEST_S, HOTTEST_K = 1e12, 1e4
"""Beyond any camera: 30 000 years, and six times the melting point of silicon."""


@dataclass(frozen=True)
class Exposure:
    """How long the shutter is open, and how warm the sensor is.

    time_s : 0 … 1e12 [s].  temperature_k : 0 … 1e4 [K]; 298.15 K (+25 °C) as in Konnik & Welsh 2014.
    Raises InputError otherwise.
    """

    time_s: float
    temperature_k: float = 298.15

    def __post_init__(self) -> None:
        require("exposure time_s", self.time_s, 0.0, LONGEST_S, "seconds, e.g. 0.1")
        require("temperature_k", self.temperature_k, 0.0, HOTTEST_K, "kelvin, e.g. 298.15 for 25 °C")


@dataclass(frozen=True, eq=False)
class Device:
    """A camera of one serial number seen through one window: it holds the patterns that never change.

    shape, origin : (rows, columns) of the window and its first pixel, in sensor coordinates.
    given : measured maps of this window that stand in for the drawn ones, by name of the source.
    """

    serial: int
    shape: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    given: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    _drawn: dict[Any, Any] = field(default_factory=dict)
    _tiles: dict[Any, Any] = field(default_factory=dict)

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

    def rows_only(self, rows: slice) -> Device:
        """The same camera seen through ``rows`` of this window."""
        height = rows.stop - rows.start
        given = {name: x if len(x) == 1 else x[rows] for name, x in self.given.items()}
        origin = self.origin[0] + rows.start, self.origin[1]
        return Device(self.serial, (height, self.shape[1]), origin, given, _tiles=self._tiles)

    def fixed(self, name: str, make: Callable[[], Any]) -> Any:
        """The map called ``name``: the measured one where one was given, else ``make()``."""
        return self.given[name] if name in self.given else make()

    def spread(self, name: str, mean: float, variance: float) -> tuple[float, float]:
        """Mean and variance of that map over the window: the measured one's where one was given."""
        if name not in self.given:
            return mean, variance
        return float(np.mean(self.given[name])), float(np.var(self.given[name]))

    def pattern(self, source: str, law: Callable[[Words], Any]) -> Any:
        """The fixed pattern of ``source``, (H, W): ``law`` turns its words into values, once per camera."""
        return self.once((source, law), lambda: law(self._words(source, self.rows, self.columns)))

    def correlated(self, source: str, coupling: float) -> Any:
        """Standard normals (H, W) whose neighbours along rows and columns correlate by 2·coupling (separable AR)."""
        margin = draws.AR_MAP_MARGIN

        def make() -> Any:
            rows, row_slice = _aligned(self.rows, draws.AR_MAP_BLOCK)
            columns, column_slice = _aligned(self.columns, draws.AR_MAP_BLOCK)
            return np.block([[self._ar_tile(source, y, x, coupling, margin) for x in columns] for y in rows])[
                row_slice, column_slice
            ]

        return self.once((source, coupling), make)

    def _ar_tile(self, source: str, y: int, x: int, coupling: float, margin: int) -> Any:
        """One tile at a fixed place of the sensor, so that every window sees the same bits; the last one is kept."""
        if self._tiles.get((source, coupling, x), (None,))[0] != y:
            size = draws.AR_MAP_BLOCK
            rows, columns = np.arange(y - margin, y + size + margin), np.arange(x - margin, x + size + margin)
            white = draws.normal(self._words(source, rows, columns))
            tile = draws.isotropic_ar(draws.isotropic_ar(white, coupling, margin).T, coupling, margin).T
            self._tiles[source, coupling, x] = y, tile
        return self._tiles[source, coupling, x][1]

    def line_pattern(self, source: str, coupling: float, axis: int = 1) -> Any:
        """A fixed offset of every column (axis 1: (1, W)) or row (axis 0: (H, 1)): mean 0, variance 1, AR-coupled."""

        def make() -> Any:
            starts, window = _aligned((self.rows, self.columns)[axis], draws.AR_BLOCK)
            line = np.concatenate([self._ar_line(source, start, coupling, axis) for start in starts])[window]
            return line[None, :] if axis else line[:, None]

        return self.once((source, coupling, axis), make)

    def _ar_line(self, source: str, start: int, coupling: float, axis: int) -> Any:
        margin, zero = draws.AR_WARM_UP, np.zeros(1, dtype=np.int64)
        along = np.arange(start - margin, start + draws.AR_BLOCK + margin)
        place = (zero, along) if axis else (along, zero)
        return draws.isotropic_ar(draws.normal(self._words(source, *place)).ravel(), coupling, margin)

    def _words(self, source: str, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Words:
        number, word = PLACES[source]
        return block(number, rows, columns, 0, self.serial)[word]

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """What ``make`` makes, made once per camera."""
        if key not in self._drawn:
            self._drawn[key] = make()
        return self._drawn[key]


def _aligned(places: NDArray[np.int64], size: int) -> tuple[list[int], slice]:
    """Starts of the blocks of ``size`` that cover ``places``, and where those lie in the joined blocks."""
    first = int(places[0]) // size * size
    return list(range(first, int(places[-1]) + 1, size)), slice(int(places[0]) - first, int(places[-1]) + 1 - first)


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

    def words(self, source: str) -> Words:
        """The temporal words of ``source``, (H, W)."""
        number, word = PLACES[source]
        if number not in self._blocks:
            device = self.device
            self._blocks[number] = block(number, device.rows, device.columns, self.index, self.seed)
        return self._blocks[number][word]

    def telegraph(self, site: NDArray[np.bool_], switching: float, duty: float) -> NDArray[np.float64]:
        """Whether the trap of each ``site`` is on in this frame, 1 or 0, (H, W).

        A trap is drawn anew with chance ``switching`` per frame and is then on with chance ``duty``; its state is that
        of the latest such frame, which is looked for backwards, so any frame can be made alone.
        """
        state = np.zeros(self.device.shape)
        rows, columns = np.nonzero(site)
        index = self.index
        while rows.size:
            switch, on = (
                self._at("blinking_switch", rows, columns, index),
                self._at("blinking_state", rows, columns, index),
            )
            drawn = (draws.survival(switch) < switching) | (index == 0)
            state[rows[drawn], columns[drawn]] = draws.survival(on[drawn]) < duty
            rows, columns, index = rows[~drawn], columns[~drawn], index - 1
        return state

    def _at(self, source: str, rows: NDArray[np.intp], columns: NDArray[np.intp], frame: int) -> Words:
        number, word = PLACES[source]
        x, y = self.device.columns[columns].astype(np.uint64), self.device.rows[rows].astype(np.uint64)
        return philox((x, y, np.uint64(frame), np.uint64(number)), self.seed)[word]  # type: ignore[arg-type]

    def normal(self, source: str) -> Any:
        """Standard normal noise of ``source``, new in every frame, (H, W)."""
        return draws.normal(self.words(source))

    def poisson(self, source: str, mean: Any) -> Any:
        """Poisson counts of ``source`` about ``mean`` (scalar or (H, W)), (H, W)."""
        return draws.poisson(self.words(source), mean)
