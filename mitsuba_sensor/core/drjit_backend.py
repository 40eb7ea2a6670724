"""Dr.Jit backend: the stages are traced once and compiled into one kernel, for LLVM (CPU) or CUDA (GPU).

Pixels form one long array; row and column follow from the index. Everything that changes between calls (camera
parameters, seeds, window size) is passed as data ("opaque"), so only a different set of stages compiles a new kernel.
"""

import importlib
from collections.abc import Mapping
from functools import reduce
from operator import and_
from typing import Self

import numpy as np

from .backend import FLOAT32_LIMIT, NumpyFloat32, PendingStrip, aligned_float32, within_float32
from .counter_rng import philox, split_key
from .llvm import drjit
from .quantiles import binomial, poisson
from .sensor_window import SensorWindow
from .signals import Filters
from .types import Array, DrJitModule, Float64Array, NumpyArray


class DrJitBackend(NumpyFloat32):
    """Dr.Jit in float32.  backend : "llvm" or "cuda".  differentiable : use types that carry derivatives."""

    compiled = True
    strip_pixels = (
        2**22
    )  # per kernel launch: a map has exactly 16 MiB, a power of two for Dr.Jit

    def __init__(self, backend: str = "llvm", differentiable: bool = False) -> None:
        self.dr: DrJitModule = drjit()
        self._backend = backend
        self.bytes_of_numpy = backend == "llvm"  # not yet measured for CUDA
        module = importlib.import_module(f"drjit.{backend}{'.ad' * differentiable}")
        self.float, self.uint, self.double = module.Float32, module.UInt32, module.Float64

    def __reduce__(self) -> tuple[type[Self], tuple[str]]:
        """Pickle by name, for frames that hold a backend."""
        return type(self), (self._backend,)

    def number(self, value: float) -> Array:
        """Return a camera parameter as a float32 that the kernel reads as data, so it is not compiled in."""
        return self.dr.opaque(self.float, within_float32(value))

    def from_numpy(self, values: Array, window: SensorWindow) -> Array:
        """Return one value per pixel; lines (1, W) or (H, 1) are looked up by column or row."""
        single = values if _is_ready(values) else aligned_float32(np.shape(values))
        if single is not values:
            np.minimum(values, FLOAT32_LIMIT, out=single, casting="same_kind")
        if single.size == 1:
            return DrJitBackend.number(self, float(single.ravel()[0]))  # a map, not a parameter
        values = self.float(single.ravel())
        if single.shape == window.shape:
            return values
        column, row = self._coordinates(window)
        return self.dr.gather(self.float, values, column if single.shape[0] == 1 else row)

    def filtered(self, layers: Float64Array, filters: Filters, window: SensorWindow) -> Array:
        """Return layers (H, W, B) after the filters, computed in float64 by the kernel, which reads them in place.

        Like :meth:`from_numpy` of the product: clipped, with ∞·0 = 0; 0 for a negative or NaN layer.
        """
        dr, value = self.dr, self.double(layers.ravel())
        if len(filters.shares) == 1:
            share = dr.opaque(self.double, filters.shares[0])
        else:
            number = self._tiled(filters.tile, window)
            pixel = dr.arange(self.uint, window.shape[0] * window.shape[1])
            layer = dr.gather(self.uint, self.uint(filters.layers), number)
            value = dr.gather(self.double, value, pixel * layers.shape[2] + layer)
            share = dr.gather(self.double, self.double(filters.shares), number)
        product = value * share
        limited = dr.select(product < FLOAT32_LIMIT, product, FLOAT32_LIMIT)
        return self.float(dr.select(product >= 0, limited, 0.0))

    def faulty(self, layers: Float64Array) -> Array:
        """Return a mask of the pixels with any negative or NaN layer of (H, W, B)."""
        given, bands = self.double(layers.ravel()), layers.shape[2]
        if bands == 1:
            return ~(given >= 0)
        first = self.dr.arange(self.uint, layers.shape[0] * layers.shape[1]) * bands
        good = [self.dr.gather(self.double, given, first + band) >= 0 for band in range(bands)]
        return ~reduce(and_, good)

    def schedule(self, *arrays: Array) -> None:
        """Compute these arrays together with the next kernel."""
        self.dr.schedule(*arrays)

    def any(self, mask: Array) -> bool:
        """Return True if any pixel of a mask is set."""
        return bool(self.dr.any(mask)[0])

    def to_numpy(self, signal: Array, window: SensorWindow) -> NumpyArray:
        """Run the kernel and wait for it."""
        if isinstance(signal, float | int | np.ndarray):
            return np.broadcast_to(np.asarray(signal), window.shape)
        values = signal.numpy()
        return np.broadcast_to(
            values if values.size == 1 else values.reshape(window.shape), window.shape
        )

    def neighbour(self, signal: Array, window: SensorWindow, rows: int, columns: int) -> Array:
        """Return the signal of the pixels this many rows below and columns to the right; edge pixels repeat."""
        if isinstance(signal, float | int | np.ndarray) or len(signal) == 1:
            return signal
        (height, width), (column, row) = window.shape, self._coordinates(window)
        below, right = self._moved(row, rows, height), self._moved(column, columns, width)
        return self.dr.gather(self.float, signal, below * self._opaque(width) + right)

    def _moved(self, number: Array, by: int, length: int) -> Array:
        """Return shifted row or column numbers, clipped to the window."""
        if by < 0:
            return self.dr.select(number >= -by, number - (-by), self.uint(0))
        return self.dr.minimum(number + by, self._opaque(length - 1))

    def pending(
        self, signal: Array, window: SensorWindow, out: NumpyArray, masks: Mapping[str, Array]
    ) -> PendingStrip:
        """Return digital numbers and masks that one kernel launch computes."""
        return KernelLaunch(self.dr, self.uint(signal), out, masks)

    def evaluate(self, window: SensorWindow) -> None:
        """Compute all FPN maps of the window in one kernel, also lines, because a look-up is slower than a load."""
        self.dr.eval([x for x in window.cached_values.values() if isinstance(x, self.float)])

    def random_bits(
        self, block: int, window: SensorWindow, frame: int, key: int
    ) -> tuple[Array, Array, Array, Array]:
        """Return four random 32-bit integers of ``block`` for every pixel of the window."""
        column, row = self._coordinates(window)
        place = *window.origin, frame, *split_key(key)
        top, left, number, low, high = map(self._opaque, place)
        return philox((column + left, row + top, number, self.uint(block)), (low, high))

    def poisson(self, bits: Array, mean: Array) -> Array:
        """Return Poisson counts of this ``mean``, one for all or one per pixel."""
        zeros = self.dr.zeros(self.float, len(bits))  # a branch is as long as its condition
        return poisson(bits, self.float(mean) + zeros)

    def split(
        self, bits: Array, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        """Split Poisson counts of mean light + dark into two independent counts."""
        zeros = self.dr.zeros(self.float, len(bits))
        counted = binomial(bits, *(self.float(x) + zeros for x in (count, dark, light)))
        return count - counted, counted

    def _opaque(self, value: int) -> Array:
        return self.dr.opaque(self.uint, value)

    def _coordinates(self, window: SensorWindow) -> tuple[Array, Array]:
        """Return column and row of every pixel, from its index and a product with 2³²/width."""

        def make() -> tuple[Array, Array]:
            (height, width), select = window.shape, self.dr.select
            number = self.dr.arange(self.uint, height * width)
            if width == 1:
                return number * 0, number
            across = self._opaque(width)
            row = self.dr.mul_hi(number, self._opaque(2**32 // width))  # may be one too small
            column = number - row * across
            short = column >= across
            return select(short, column - across, column), select(short, row + 1, row)

        return window.cached("coordinates", make)

    def _tiled(self, tile: tuple[tuple[int, ...], ...], window: SensorWindow) -> Array:
        """Return the number in the tile at every pixel; the tile starts at the sensor's first pixel."""
        (rows, columns), (top, left) = np.shape(tile), window.origin
        column, row = self._coordinates(window)
        y = (row + self._opaque(top % rows)) % rows
        x = (column + self._opaque(left % columns)) % columns
        return self.dr.gather(self.uint, self.uint(np.ravel(tile).tolist()), y * columns + x)


def _is_ready(values: Array) -> bool:
    """Return True if Dr.Jit can read an array in place: aligned float32 within the limit, as from detection.py."""
    return bool(
        isinstance(values, np.ndarray)
        and values.dtype == np.float32
        and values.flags.c_contiguous
        and values.ctypes.data % 64 == 0
        and values.size
        and values.max() <= FLOAT32_LIMIT
    )


class KernelLaunch(PendingStrip):
    """A kernel that runs in other threads while this thread traces the next kernel or copies the previous codes.

    Dr.Jit has no 16-bit integers, so NumPy converts. Reading an array waits for *all* kernels, so the next kernel is
    launched after the wait for this kernel and before its codes are copied.
    """

    def __init__(
        self, dr: DrJitModule, codes: Array, out: NumpyArray, masks: Mapping[str, Array]
    ) -> None:
        self.dr, self.codes, self.out, self.masks = dr, codes, out, masks

    def launch(self) -> None:
        self.dr.eval(self.codes, list(self.masks.values()))

    def wait(self) -> None:
        self.computed = self.codes.numpy()

    def copy(self) -> None:
        np.copyto(self.out, self.computed.reshape(self.out.shape), casting="unsafe")
        self.counts = {
            name: 0 if mask is False else self.dr.count(mask)[0]
            for name, mask in self.masks.items()
        }
