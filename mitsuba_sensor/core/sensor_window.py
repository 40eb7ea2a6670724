"""Fixed-pattern noise (FPN) maps of a sensor window, keyed by camera, serial number and source."""

import threading
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import distributions
from .backend import NUMPY_FLOAT64, Backend
from .counter_rng import CHARGE_SOURCES, key_of, random_bits_at, stream_of
from .errors import require_seed
from .types import Array, Float64Array, RandomBits

Value = TypeVar("Value")
CACHED_LINES = 64
"""Blocks of coupled normals that are cached, of the latest sensor units."""


@dataclass(frozen=True, eq=False)
class SensorWindow:
    """A rectangle of pixels of the camera with this serial number, and its fixed-pattern noise (FPN) maps.

    shape : rows, columns.  origin : row and column of the first pixel on the sensor.  given : measured maps, which
    replace random maps.  camera : its name; the same serial number of another camera is another sensor unit.
    photodiode, readout : names, empty for the first.
    """

    serial: int
    shape: tuple[int, int]
    origin: tuple[int, int] = (0, 0)
    given: Mapping[str, Float64Array] = field(default_factory=dict)
    backend: Backend = NUMPY_FLOAT64
    camera: str = ""
    photodiode: str = ""
    readout: str = ""
    _maps: dict[Hashable, Array] = field(default_factory=dict)
    _tiles: dict[Hashable, tuple[int, Float64Array]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        serial = require_seed("serial", self.serial)  # a NumPy integer would overflow
        object.__setattr__(self, "serial", serial)

    def __reduce__(self) -> tuple[type[Self], tuple[object, ...]]:
        """Pickle without maps; they are computed again."""
        place = self.serial, self.shape, self.origin, dict(self.given), self.backend
        return type(self), (*place, self.camera, self.photodiode, self.readout)

    @cached_property
    def key(self) -> int:
        """Key of the FPN maps, equal for all frames, exposures and gain settings of a sensor unit."""
        return key_of("fixed", self.camera, self.serial)

    def key_of_source(self, source: str) -> int:
        """Return the key of the FPN map of a source; all readouts share the maps of the photodiode."""
        if self.readout and source not in CHARGE_SOURCES:
            return key_of("fixed", self.camera, self.serial, self.photodiode, self.readout)
        if self.photodiode:
            return key_of("fixed", self.camera, self.serial, self.photodiode)
        return self.key

    @property
    def rows(self) -> NDArray[np.int64]:
        """Row numbers of the window on the sensor."""
        return np.arange(self.origin[0], self.origin[0] + self.shape[0])

    @property
    def columns(self) -> NDArray[np.int64]:
        """Column numbers of the window on the sensor."""
        return np.arange(self.origin[1], self.origin[1] + self.shape[1])

    def crop_rows(self, rows: slice) -> Self:
        """Return the window with only these rows."""
        given = {name: x if len(x) == 1 else x[rows] for name, x in self.given.items()}
        origin = self.origin[0] + rows.start, self.origin[1]
        shape = rows.stop - rows.start, self.shape[1]
        return replace(self, shape=shape, origin=origin, given=given, _maps={})

    def measured_or(self, name: str, make: Callable[[], Array]) -> Array:
        """Return the measured FPN map of this name if it was given, else ``make()``."""
        if name not in self.given:
            return make()
        return self.cached(
            ("given", name), lambda: self.backend.from_numpy(self.given[name], self)
        )

    def number(self, value: float) -> Array:
        """Return a camera parameter in the precision of the backend."""
        return self.backend.number(value)

    @property
    def cached_values(self) -> dict[Hashable, Array]:
        """All cached values of this window by key, including FPN maps."""
        return self._maps

    def fixed_map(self, source: str, distribution: Callable[[Backend, Array], Array]) -> Array:
        """Return the FPN map of ``source``, shape (H, W); ``distribution`` converts its random bits once."""
        block, slot = stream_of(source, fixed=True)
        backend, key = self.backend, (source, distribution)

        def make() -> Array:
            bits = backend.random_bits(block, self, 0, self.key_of_source(source))
            return distribution(backend, bits[slot])

        return self.cached(key, make)

    def correlated(self, source: str, coupling: float) -> Array:
        """Return standard normals (H, W) whose row and column neighbours correlate by 2·coupling (separable AR)."""
        margin = distributions.AR_MAP_MARGIN

        def make() -> Array:
            rows, row_slice = _blocks(self.rows, distributions.AR_MAP_BLOCK)
            columns, column_slice = _blocks(self.columns, distributions.AR_MAP_BLOCK)
            with self._lock:
                tiles = [
                    [self._ar_tile(source, y, x, coupling, margin) for x in columns]
                    for y in rows
                ]
            return self.backend.from_numpy(np.block(tiles)[row_slice, column_slice], self)

        return self.cached((source, coupling), make)

    def _ar_tile(
        self, source: str, y: int, x: int, coupling: float, margin: int
    ) -> Float64Array:
        """Return a tile of a fixed grid on the sensor, so all windows agree; the last tile is cached."""
        place = (self.photodiode, self.readout, source, coupling, x)
        if self._tiles.get(place, (None,))[0] != y:
            size = distributions.AR_MAP_BLOCK
            around = np.arange(-margin, size + margin)
            key = self.key_of_source(source)
            bits = _bits_at(source, key, y + around[:, None], x + around[None, :])
            along = distributions.isotropic_ar(distributions.normal(bits), coupling, margin)
            self._tiles[place] = y, distributions.isotropic_ar(along.T, coupling, margin).T
        return self._tiles[place][1]

    def line_map(self, source: str, coupling: float, axis: int = 1) -> Array:
        """Return the FPN of columns (axis 1: (1, W)) or rows (axis 0: (H, 1)): coupled standard normals (AR)."""

        def make() -> Array:
            key = self.key_of_source(source)
            starts, window = _blocks((self.rows, self.columns)[axis], distributions.AR_BLOCK)
            blocks = [_ar_line(source, key, start, coupling, axis) for start in starts]
            line = np.concatenate(blocks)[window]
            return self.backend.from_numpy(line[None, :] if axis else line[:, None], self)

        return self.cached((source, coupling, axis), make)

    def cached(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the result of ``make``, computed once per window and readout."""
        if self.photodiode or self.readout:
            key = (self.photodiode, self.readout, key)
        if key not in self._maps:
            self._maps[key] = make()
        value: Value = self._maps[key]
        return value


@lru_cache(maxsize=CACHED_LINES)
def _ar_line(source: str, key: int, start: int, coupling: float, axis: int) -> Float64Array:
    """Return a block of coupled standard normals, shared by all windows of a sensor unit.  key : of the source."""
    margin, zero = distributions.AR_WARM_UP, np.zeros(1, dtype=np.int64)
    along = np.arange(start - margin, start + distributions.AR_BLOCK + margin)
    place = (zero, along) if axis else (along, zero)
    white = distributions.normal(_bits_at(source, key, *place))
    line = distributions.isotropic_ar(white, coupling, margin)
    line.setflags(write=False)
    return line


def _bits_at(
    source: str, key: int, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> RandomBits:
    block, slot = stream_of(source, fixed=True)
    return random_bits_at(block, rows, columns, 0, key)[slot]


def _blocks(numbers: NDArray[np.int64], size: int) -> tuple[list[int], slice]:
    """Return the starts of the aligned blocks of ``size`` that cover these numbers, and their slice in the blocks."""
    low, high = int(numbers[0]), int(numbers[-1]) + 1
    first = low // size * size
    return list(range(first, high, size)), slice(low - first, high - first)
