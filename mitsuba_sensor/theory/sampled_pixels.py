"""Pixels over which the law of a pixel is averaged: at real places of the sensor, each of another serial number.

The random numbers of a fixed-pattern noise map are spread evenly over its law (a Latin hypercube: McKay, Beckman and
Conover, Technometrics 21, 239, 1979), so that few pixels show what many serials would. What pixels of a row or column
share is drawn for each of them alone, for an average asks for the law of one pixel only.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Frame, SensorWindow, distributions
from ..core.backend import NUMPY_FLOAT64, Backend
from ..core.counter_rng import OF_CHARGE, key_of
from ..core.types import Array, Float64Array, RandomBits

PIXELS = 2**16
"""Pixels of a sample: the standard error of a standard deviation is then 0.28 % of it, where all of it is normal."""


@dataclass(frozen=True, eq=False)
class SampledWindow(SensorWindow):
    """Pixels where rows and columns of a sensor cross, which need not be neighbours.

    row_numbers, column_numbers : of these, in sensor coordinates; a row may come more than once.
    maps : "sampled", each pixel of a serial number of its own, or "median", every number the middle of its law.
    first_row, sample_rows : where these rows stand in the whole sample, and how many it has.
    """

    row_numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    column_numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    maps: Literal["sampled", "median"] = "sampled"
    first_row: int = 0
    sample_rows: int = 0
    _bits: dict[str, RandomBits] = field(default_factory=dict)
    _bits_lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Row numbers of the pixels, in sensor coordinates."""
        return self.row_numbers

    @property
    def columns(self) -> NDArray[np.int64]:
        """Column numbers of the pixels, in sensor coordinates."""
        return self.column_numbers

    def crop_rows(self, rows: slice) -> Self:
        """Some rows of the sample."""
        given = {name: x if len(x) == 1 else x[rows] for name, x in self.given.items()}
        numbers = self.row_numbers[rows]
        return replace(
            self,
            shape=(numbers.size, self.shape[1]),
            given=given,
            row_numbers=numbers,
            first_row=self.first_row + rows.start,
            _maps={},
        )

    def fixed_map(self, source: str, distribution: Callable[[Backend, Array], Array]) -> Array:
        """Map of ``source`` of all these pixels, (H, W)."""
        key = (source, distribution)
        return self.cached(key, lambda: distribution(self.backend, self._random_bits(source)))

    def correlated(self, source: str, coupling: float) -> Array:
        """Standard normals (H, W); neighbours here are none on the sensor."""
        return self.normal(source)

    def line_map(self, source: str, coupling: float, axis: int = 1) -> Array:
        """Standard normals (H, W): of each pixel's own row or column."""
        return self.normal(source)

    def normal(self, source: str) -> Array:
        """Standard normals of ``source``, (H, W)."""
        return self.cached(
            (source, "normal"), lambda: distributions.normal(self._random_bits(source))
        )

    def _owner(self, source: str) -> str:
        """The photodiode, or the read-out, of a pixel with several whose own a source is; empty for one alone."""
        if self.readout and source not in OF_CHARGE:
            return f"{self.photodiode}/{self.readout}/"
        if self.photodiode:
            return f"{self.photodiode}/"
        return ""

    def _random_bits(self, source: str) -> RandomBits:
        """Random bits of these pixels, which are evenly spread over the whole sample."""
        if self.maps == "median":
            return np.full(self.shape, 2**31, np.uint32)
        source = f"{self._owner(source)}{source}"
        with self._bits_lock:
            if source not in self._bits:
                count = self.sample_rows * self.shape[1]
                random = np.random.default_rng(key_of("sampled pixels", source))
                share = (random.permutation(count) + random.random(count)) / count
                self._bits[source] = (
                    (share * 2.0**32).astype(np.uint32).reshape(self.sample_rows, -1)
                )
        return self._bits[source][self.first_row : self.first_row + self.shape[0]]


@dataclass(frozen=True, eq=False)
class SampledPixels:
    """A sample of the pixels of one frame.

    light : their mean photoelectrons, (R, C).  frame : exposure, and their window.
    window : that window, as what it is.
    """

    light: Electrons
    frame: Frame
    window: SampledWindow


def sample_pixels(light: Electrons, frame: Frame, pixels: int = PIXELS) -> SampledPixels:
    """About so many pixels of a frame: all of them, as often as it takes, or rows and columns evenly spread over it.

    light : mean photoelectrons of its window, (H, W) or one value.
    """
    height, width = frame.window.shape
    if height * width <= pixels:
        rows, columns = (
            np.tile(np.arange(height), -(-pixels // (height * width))),
            np.arange(width),
        )
    else:
        many_rows = min(max(round((pixels * height / width) ** 0.5), 1), height)
        many_columns = min(-(-pixels // many_rows), width)
        rows = _spread(height, min(-(-pixels // many_columns), height), "rows")
        columns = _spread(width, many_columns, "columns")
    window = sampled_window(frame.window, rows, columns, "sampled")
    some = light.mapped(lambda values: values_at(values, rows, columns))
    return SampledPixels(some, replace(frame, window=window, _blocks={}), window)


def sampled_window(
    window: SensorWindow,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    maps: Literal["sampled", "median"],
) -> SampledWindow:
    """Pixels of a window by their places in it, with its measured maps, or the middle of each of these."""
    given: Mapping[str, Float64Array] = {
        name: values_at(x, rows, columns) for name, x in window.given.items()
    }
    if maps == "median":
        given = {
            name: np.full((1, columns.size), np.median(x)) for name, x in window.given.items()
        }
    return SampledWindow(
        0,
        (rows.size, columns.size),
        given=given,
        backend=NUMPY_FLOAT64,
        camera=window.camera,
        row_numbers=window.rows[rows],
        column_numbers=window.columns[columns],
        maps=maps,
        sample_rows=rows.size,
    )


def _spread(length: int, count: int, name: str) -> NDArray[np.int64]:
    """So many numbers below ``length``, one at random out of each of as many equal parts."""
    random = np.random.default_rng(key_of("sampled pixels", name))
    places = (np.arange(count) + random.random(count)) * (length / count)
    return np.minimum(places.astype(np.int64), length - 1)


def values_at(values: Array, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    """Values of pixels, of rows (H, 1), of columns (1, W) or of all, at these places; None stays None."""
    if values is None or np.ndim(values) == 0:
        return values
    values = np.asarray(values)
    if values.shape[0] > 1:
        some_rows = rows
    else:
        some_rows = np.zeros(1, np.int64)
    if values.shape[1] > 1:
        some_columns = columns
    else:
        some_columns = np.zeros(1, np.int64)
    return values[np.ix_(some_rows, some_columns)]
