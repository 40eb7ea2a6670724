"""Dr.Jit backend: the stages are traced once and compiled into one kernel, for LLVM (CPU) or CUDA (GPU).

Pixels lie in one long array; row and column of a pixel follow from its index. Whatever may change from call to call
(parameters of the camera, seeds, size of the window) is passed as data ("opaque"), so that only another choice of
stages compiles another kernel.
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
    """Dr.Jit in float32.  backend : "llvm" or "cuda".  differentiable : use the types that carry derivatives."""

    compiled = True
    strip_pixels = (
        2**22
    )  # per kernel launch: a map has exactly 16 MiB, and Dr.Jit rounds memory up to powers of two

    def __init__(self, backend: str = "llvm", differentiable: bool = False) -> None:
        self.dr: DrJitModule = drjit()
        self._backend = backend
        self.bytes_of_numpy = backend == "llvm"  # of CUDA it is not measured yet
        module = importlib.import_module(
            f"drjit.{backend}.ad" if differentiable else f"drjit.{backend}"
        )
        self.float, self.uint, self.double = module.Float32, module.UInt32, module.Float64

    def __reduce__(self) -> tuple[type[Self], tuple[str]]:
        """Pickled by its name, for frames that hold one."""
        return type(self), (self._backend,)

    def number(self, value: float) -> Array:
        """A parameter of the camera: one float32 that the kernel reads as data instead of having it compiled in."""
        return self.dr.opaque(self.float, within_float32(value))

    def from_numpy(self, values: Array, window: SensorWindow) -> Array:
        """One value per pixel; a line (1, W) or (H, 1) is looked up by the column or row of each pixel."""
        single = values if _is_ready(values) else aligned_float32(np.shape(values))
        if single is not values:
            np.minimum(values, FLOAT32_LIMIT, out=single, casting="same_kind")
        if single.size == 1:
            return DrJitBackend.number(
                self, float(single.ravel()[0])
            )  # of a map, not of the camera
        if single.shape == window.shape:
            return self.float(single.ravel())
        column, row = self._coordinates(window)
        return self.dr.gather(
            self.float, self.float(single.ravel()), column if single.shape[0] == 1 else row
        )

    def filtered(self, layers: Float64Array, filters: Filters, window: SensorWindow) -> Array:
        """Layers (H, W, B) behind the filters, computed in float64 by the kernel, which reads them in place.

        As :meth:`from_numpy` of the product: limited, and ∞·0 = 0; 0 where the layer is negative or NaN.
        """
        dr, value = self.dr, self.double(layers.ravel())
        if len(filters.shares) == 1:
            share = dr.opaque(self.double, filters.shares[0])
        else:
            number, pixel = (
                self._tiled(filters.tile, window),
                dr.arange(self.uint, window.shape[0] * window.shape[1]),
            )
            layer = dr.gather(self.uint, self.uint(filters.layers), number)
            value = dr.gather(self.double, value, pixel * layers.shape[2] + layer)
            share = dr.gather(self.double, self.double(filters.shares), number)
        product = value * share
        limited = dr.select(product < FLOAT32_LIMIT, product, FLOAT32_LIMIT)
        return self.float(dr.select(product >= 0, limited, 0.0))

    def faulty(self, layers: Float64Array) -> Array:
        """A mask of the pixels in which any of the layers (H, W, B) is negative or NaN."""
        given, bands = self.double(layers.ravel()), layers.shape[2]
        if bands == 1:
            return ~(given >= 0)
        first = self.dr.arange(self.uint, layers.shape[0] * layers.shape[1]) * bands
        good = [self.dr.gather(self.double, given, first + band) >= 0 for band in range(bands)]
        return ~reduce(and_, good)

    def schedule(self, *arrays: Array) -> None:
        """Compute these together with the next kernel."""
        self.dr.schedule(*arrays)

    def any(self, mask: Array) -> bool:
        """Whether a mask has a pixel."""
        return bool(self.dr.any(mask)[0])

    def to_numpy(self, signal: Array, window: SensorWindow) -> NumpyArray:
        """Run the kernel and wait for it."""
        if isinstance(signal, float | int | np.ndarray):
            return np.broadcast_to(np.asarray(signal), window.shape)
        found = signal.numpy()
        return (
            np.broadcast_to(found[0], window.shape)
            if found.size == 1
            else found.reshape(window.shape)
        )

    def neighbour(self, signal: Array, window: SensorWindow, rows: int, columns: int) -> Array:
        """What the pixels so many rows below and columns to the right have, or the last pixel of the window there."""
        if isinstance(signal, float | int | np.ndarray) or len(signal) == 1:
            return signal
        (height, width), (column, row) = window.shape, self._coordinates(window)
        below, right = self._moved(row, rows, height), self._moved(column, columns, width)
        return self.dr.gather(self.float, signal, below * self._opaque(width) + right)

    def _moved(self, number: Array, by: int, length: int) -> Array:
        """Numbers of rows or columns, moved and kept on the window."""
        if by < 0:
            return self.dr.select(number >= -by, number - (-by), self.uint(0))
        return self.dr.minimum(number + by, self._opaque(length - 1))

    def pending(
        self, signal: Array, window: SensorWindow, out: NumpyArray, masks: Mapping[str, Array]
    ) -> PendingStrip:
        """Digital numbers, and masks, that one kernel launch computes."""
        return KernelLaunch(self.dr, self.uint(signal), out, masks)

    def evaluate(self, window: SensorWindow) -> None:
        """Compute all FPN maps of the window in one kernel, lines too: a look-up is slower than a load."""
        self.dr.eval([x for x in window.cached_values.values() if isinstance(x, self.float)])

    def random_bits(
        self, block: int, window: SensorWindow, frame: int, key: int
    ) -> tuple[Array, Array, Array, Array]:
        """Four random 32-bit integers of ``block`` for every pixel of the window."""
        column, row = self._coordinates(window)
        top, left, number, low, high = (
            self._opaque(value) for value in (*window.origin, frame, *split_key(key))
        )
        return philox((column + left, row + top, number, self.uint(block)), (low, high))

    def poisson(self, bits: Array, mean: Array) -> Array:
        """Poisson counts of this ``mean``, one for all or one per pixel."""
        zeros = self.dr.zeros(
            self.float, len(bits)
        )  # a branch has the length of its condition, not of its arguments
        return poisson(bits, self.float(mean) + zeros)

    def split(
        self, bits: Array, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        """A Poisson count of mean light + dark in two independent ones."""
        zeros = self.dr.zeros(self.float, len(bits))
        counted = binomial(bits, *(self.float(x) + zeros for x in (count, dark, light)))
        return count - counted, counted

    def _opaque(self, value: int) -> Array:
        return self.dr.opaque(self.uint, value)

    def _coordinates(self, window: SensorWindow) -> tuple[Array, Array]:
        """Column and row of every pixel: its index modulo and divided by the width, a product with 2³²/width."""

        def make() -> tuple[Array, Array]:
            (height, width), select = window.shape, self.dr.select
            number = self.dr.arange(self.uint, height * width)
            if width == 1:
                return number * 0, number
            across = self._opaque(width)
            row = self.dr.mul_hi(number, self._opaque(2**32 // width))  # the row, or one less
            column = number - row * across
            short = column >= across
            return select(short, column - across, column), select(short, row + 1, row)

        return window.cached("coordinates", make)

    def _tiled(self, tile: tuple[tuple[int, ...], ...], window: SensorWindow) -> Array:
        """The number in the tile at every pixel; the tile begins at the sensor's first one."""
        (rows, columns), (top, left), (column, row) = (
            np.shape(tile),
            window.origin,
            self._coordinates(window),
        )
        y, x = (
            (row + self._opaque(top % rows)) % rows,
            (column + self._opaque(left % columns)) % columns,
        )
        return self.dr.gather(
            self.uint, self.uint([number for line in tile for number in line]), y * columns + x
        )


def _is_ready(values: Array) -> bool:
    """Whether Dr.Jit can read an array in place: aligned float32, as detection.py makes it, within the limit."""
    ready = (
        isinstance(values, np.ndarray)
        and values.dtype == np.float32
        and values.flags.c_contiguous
    )
    return bool(
        ready and values.ctypes.data % 64 == 0 and values.size and values.max() <= FLOAT32_LIMIT
    )


class KernelLaunch(PendingStrip):
    """A kernel that other threads run while this one traces the next, or copies the codes of the one before.

    Dr.Jit has no 16-bit integers, so NumPy converts. Reading an array waits for *all* kernels; therefore the next
    kernel is launched after the wait for this one and before its codes are copied.
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
