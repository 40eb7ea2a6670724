"""One exposure of one camera: time, temperature, and where its random words come from."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import draws
from .errors import require, require_seed
from .lanes import REFERENCE, Lanes
from .words import PLACES, at

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
    lanes : who computes the patterns and the frames.
    """

    serial: int
    shape: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    given: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    lanes: Lanes = REFERENCE
    _drawn: dict[Any, Any] = field(default_factory=dict)
    _tiles: dict[Any, Any] = field(default_factory=dict)
    _lock: Any = field(default_factory=threading.Lock)

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
        shape = height, self.shape[1]
        return Device(self.serial, shape, origin, given, self.lanes, _tiles=self._tiles, _lock=self._lock)

    def fixed(self, name: str, make: Callable[[], Any]) -> Any:
        """The map called ``name``: the measured one where one was given, else ``make()``."""
        if name in self.given:
            return self.once(("given", name), lambda: self.lanes.take(self.given[name], self))
        return make()

    def number(self, value: float) -> Any:
        """A number of the camera, as the engine lets it meet the pixels."""
        return self.lanes.number(value)

    @property
    def drawn(self) -> dict[Any, Any]:
        """Every map that the device holds so far, among all that it makes once."""
        return dict(self._drawn)

    def hold(self, key: Any, values: Any) -> None:
        """Take ``values`` for what was made once under ``key``: the same numbers in another place."""
        self._drawn[key] = values

    def spread(self, name: str, mean: float, variance: float) -> tuple[float, float]:
        """Mean and variance of that map over the window: the measured one's where one was given."""
        if name not in self.given:
            return mean, variance
        return float(np.mean(self.given[name])), float(np.var(self.given[name]))

    def pattern(self, source: str, law: Callable[[Lanes, Any], Any]) -> Any:
        """The fixed pattern of ``source``, (H, W): ``law`` turns its words into values, once per camera."""
        number, word = PLACES[source]
        return self.once((source, law), lambda: law(self.lanes, self.lanes.block(number, self, 0, self.serial)[word]))

    def correlated(self, source: str, coupling: float) -> Any:
        """Standard normals (H, W) whose neighbours along rows and columns correlate by 2·coupling (separable AR)."""
        margin = draws.AR_MAP_MARGIN

        def make() -> Any:
            rows, row_slice = _aligned(self.rows, draws.AR_MAP_BLOCK)
            columns, column_slice = _aligned(self.columns, draws.AR_MAP_BLOCK)
            with self._lock:
                tiles = [[self._ar_tile(source, y, x, coupling, margin) for x in columns] for y in rows]
            return self.lanes.take(np.block(tiles)[row_slice, column_slice], self)

        return self.once((source, coupling), make)

    def _ar_tile(self, source: str, y: int, x: int, coupling: float, margin: int) -> Any:
        """One tile at a fixed place of the sensor, so that every window sees the same bits; the last one is kept."""
        if self._tiles.get((source, coupling, x), (None,))[0] != y:
            size = draws.AR_MAP_BLOCK
            rows, columns = np.arange(y - margin, y + size + margin), np.arange(x - margin, x + size + margin)
            white = draws.normal(self._words(source, rows[:, None], columns[None, :]))
            tile = draws.isotropic_ar(draws.isotropic_ar(white, coupling, margin).T, coupling, margin).T
            self._tiles[source, coupling, x] = y, tile
        return self._tiles[source, coupling, x][1]

    def line_pattern(self, source: str, coupling: float, axis: int = 1) -> Any:
        """A fixed offset of every column (axis 1: (1, W)) or row (axis 0: (H, 1)): mean 0, variance 1, AR-coupled."""

        def make() -> Any:
            starts, window = _aligned((self.rows, self.columns)[axis], draws.AR_BLOCK)
            line = np.concatenate([self._ar_line(source, start, coupling, axis) for start in starts])[window]
            return self.lanes.take(line[None, :] if axis else line[:, None], self)

        return self.once((source, coupling, axis), make)

    def _ar_line(self, source: str, start: int, coupling: float, axis: int) -> Any:
        margin, zero = draws.AR_WARM_UP, np.zeros(1, dtype=np.int64)
        along = np.arange(start - margin, start + draws.AR_BLOCK + margin)
        place = (zero, along) if axis else (along, zero)
        return draws.isotropic_ar(draws.normal(self._words(source, *place)), coupling, margin)

    def _words(self, source: str, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Any:
        number, word = PLACES[source]
        return at(number, rows, columns, 0, self.serial)[word]

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

    def on(self, lanes: Lanes) -> Frame:
        """The same frame of the same camera, computed by ``lanes``."""
        device = self.device
        other = Device(device.serial, device.shape, device.origin, device.given, lanes)
        return Frame(self.exposure, other, self.seed, self.index)

    def number(self, value: float) -> Any:
        """A number of the camera, as the engine lets it meet the pixels."""
        return self.device.number(value)

    def words(self, source: str) -> Any:
        """The temporal words of ``source``, (H, W)."""
        number, word = PLACES[source]
        if number not in self._blocks:
            self._blocks[number] = self.device.lanes.block(number, self.device, self.index, self.seed)
        return self._blocks[number][word]

    def telegraph(self, site: Any, switching: float, duty: float) -> Any:
        """Whether the trap of each ``site`` (above 0) is on in this frame, 1 or 0, (H, W).

        A trap is drawn anew with chance ``switching`` per frame and is then on with chance ``duty``; its state is that
        of the latest such frame, which is looked for backwards, so any frame can be made alone. Traps are few: they are
        followed on the host.
        """
        device = self.device
        state = np.zeros(device.shape)
        rows, columns = device.once("sites", lambda: np.nonzero(device.lanes.give(site, device)))
        index = self.index
        while rows.size:
            switch, on = (
                self._at("blinking_switch", rows, columns, index),
                self._at("blinking_state", rows, columns, index),
            )
            drawn = (draws.survival(switch) < switching) | (index == 0)
            state[rows[drawn], columns[drawn]] = draws.survival(on[drawn]) < duty
            rows, columns, index = rows[~drawn], columns[~drawn], index - 1
        return device.lanes.take(state, device)

    def _at(self, source: str, rows: NDArray[np.intp], columns: NDArray[np.intp], frame: int) -> Any:
        number, word = PLACES[source]
        return at(number, self.device.rows[rows], self.device.columns[columns], frame, self.seed)[word]

    def normal(self, source: str) -> Any:
        """Standard normal noise of ``source``, new in every frame, (H, W)."""
        return self.device.lanes.normal(self.words(source))

    def poisson(self, source: str, mean: Any) -> Any:
        """Poisson counts of ``source`` about ``mean`` (scalar or (H, W)), (H, W)."""
        return self.device.lanes.poisson(self.words(source), mean)

    def bernoulli(self, source: str, chance: Any) -> Any:
        """1 with this ``chance`` (0 … 1, (H, W)), else 0, (H, W)."""
        return self.device.lanes.bernoulli(self.words(source), chance)
