"""Fixed-pattern noise (FPN) maps of a window of the sensor, keyed by camera, serial number and source."""

import threading
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import distributions
from .backend import NUMPY_FLOAT64, Backend
from .counter_rng import OF_CHARGE, key_of, random_bits_at, stream_of
from .errors import require_seed
from .types import Array, Float64Array, RandomBits

Value = TypeVar("Value")
MOST_LINES = 64
"""Blocks of lines of coupled normals that are kept, of the chips that came last."""


@dataclass(frozen=True, eq=False)
class SensorWindow:
    """A rectangle of pixels of the camera with this serial number, and its fixed-pattern noise (FPN) maps."""

    serial: int
    shape: tuple[int, int]  # rows, columns
    origin: tuple[int, int] = (0, 0)  # row and column of the first pixel, in sensor coordinates
    given: Mapping[str, Float64Array] = field(
        default_factory=dict
    )  # measured maps that replace the random ones
    backend: Backend = NUMPY_FLOAT64  # what computes the maps and the frames
    camera: str = ""  # name of the camera; serial number 1 of another one is another chip
    photodiode: str = ""  # of a pixel with several: another one than the first
    readout: str = ""  # of a pixel that is read out several times
    _maps: dict[Hashable, Array] = field(default_factory=dict)
    _tiles: dict[Hashable, tuple[int, Float64Array]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "serial", require_seed("serial", self.serial)
        )  # a NumPy integer would overflow

    def __reduce__(self) -> tuple[type[Self], tuple[object, ...]]:
        """Pickled without its maps, which are made anew."""
        return type(self), (
            self.serial,
            self.shape,
            self.origin,
            dict(self.given),
            self.backend,
            self.camera,
            self.photodiode,
            self.readout,
        )

    @cached_property
    def key(self) -> int:
        """Key of the FPN maps: the same in every frame, exposure and gain setting of this chip."""
        return key_of("fixed", self.camera, self.serial)

    def key_of_source(self, source: str) -> int:
        """Key of the FPN map of a source: what the photodiode has is the same in all read-outs of it."""
        if self.readout and source not in OF_CHARGE:
            return key_of("fixed", self.camera, self.serial, self.photodiode, self.readout)
        if self.photodiode:
            return key_of("fixed", self.camera, self.serial, self.photodiode)
        return self.key

    @property
    def rows(self) -> NDArray[np.int64]:
        """Row numbers of the window, in sensor coordinates; of pixels that the theory samples, not one by one."""
        return np.arange(self.origin[0], self.origin[0] + self.shape[0])

    @property
    def columns(self) -> NDArray[np.int64]:
        """Column numbers of the window, in sensor coordinates."""
        return np.arange(self.origin[1], self.origin[1] + self.shape[1])

    def crop_rows(self, rows: slice) -> Self:
        """The window of the same camera that has only ``rows`` of this one."""
        given = {name: x if len(x) == 1 else x[rows] for name, x in self.given.items()}
        origin, shape = (
            (self.origin[0] + rows.start, self.origin[1]),
            (rows.stop - rows.start, self.shape[1]),
        )
        return replace(self, shape=shape, origin=origin, given=given, _maps={})

    def measured_or(self, name: str, make: Callable[[], Array]) -> Array:
        """The FPN map called ``name``: the measured one if one was given, else ``make()``."""
        if name not in self.given:
            return make()
        return self.cached(
            ("given", name), lambda: self.backend.from_numpy(self.given[name], self)
        )

    def number(self, value: float) -> Array:
        """A parameter of the camera in the precision of the backend."""
        return self.backend.number(value)

    @property
    def cached_values(self) -> dict[Hashable, Array]:
        """Everything that was computed once for this window so far, FPN maps among it, by key."""
        return self._maps

    def fixed_map(self, source: str, distribution: Callable[[Backend, Array], Array]) -> Array:
        """FPN map of ``source``, (H, W): ``distribution`` turns its random bits into values, once per window."""
        block, slot = stream_of(source, fixed=True)
        backend, key = self.backend, (source, distribution)
        return self.cached(
            key,
            lambda: distribution(
                backend, backend.random_bits(block, self, 0, self.key_of_source(source))[slot]
            ),
        )

    def correlated(self, source: str, coupling: float) -> Array:
        """Standard normals (H, W) whose neighbours in rows and columns have correlation 2·coupling (separable AR)."""
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
        """One tile of a fixed grid on the sensor, so that every window has the same values; the last one is kept."""
        place = (self.photodiode, self.readout, source, coupling, x)
        if self._tiles.get(place, (None,))[0] != y:
            size = distributions.AR_MAP_BLOCK
            rows, columns = (
                np.arange(y - margin, y + size + margin),
                np.arange(x - margin, x + size + margin),
            )
            key = self.key_of_source(source)
            white = distributions.normal(_bits_at(source, key, rows[:, None], columns[None, :]))
            tile = distributions.isotropic_ar(
                distributions.isotropic_ar(white, coupling, margin).T, coupling, margin
            ).T
            self._tiles[place] = y, tile
        return self._tiles[place][1]

    def line_map(self, source: str, coupling: float, axis: int = 1) -> Array:
        """FPN of every column (axis 1: (1, W)) or row (axis 0: (H, 1)): standard normals, coupled as an AR process."""

        def make() -> Array:
            key = self.key_of_source(source)
            starts, window = _blocks((self.rows, self.columns)[axis], distributions.AR_BLOCK)
            line = np.concatenate(
                [_ar_line(source, key, start, coupling, axis) for start in starts]
            )[window]
            return self.backend.from_numpy(line[None, :] if axis else line[:, None], self)

        return self.cached((source, coupling, axis), make)

    def cached(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """What ``make`` returns, computed once per window and read-out."""
        if self.photodiode or self.readout:
            key = (self.photodiode, self.readout, key)
        if key not in self._maps:
            self._maps[key] = make()
        value: Value = self._maps[key]
        return value


@lru_cache(maxsize=MOST_LINES)
def _ar_line(source: str, key: int, start: int, coupling: float, axis: int) -> Float64Array:
    """One block of a line of coupled standard normals, which all windows of a chip share.  key : of the source."""
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
    """Starts of the aligned blocks of ``size`` that cover these rows or columns, and their slice in the blocks."""
    low, high = int(numbers[0]), int(numbers[-1]) + 1
    first = low // size * size
    return list(range(first, high, size)), slice(low - first, high - first)
