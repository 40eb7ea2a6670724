"""The engine that compiles: the stages are traced once into one kernel of Dr.Jit, for LLVM or for CUDA.

Pixels lie in one long array; a pixel's place comes from its number. Whatever may change from call to call (numbers of
the camera, seeds, the size of the window) goes in opaque, that is as data, so that only another choice of stages
compiles another kernel.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .backend import BRIGHTEST, Job, NumpyFloat32, within_float32
from .counter_rng import philox, split_key
from .llvm import drjit
from .quantiles import poisson
from .sensor_window import SensorWindow


class DrJitBackend(NumpyFloat32):
    """Dr.Jit in float32.  backend : "llvm" or "cuda".  differentiable : use the types that carry derivatives."""

    on_host = False
    strip = 2**22
    """Pixels of one launch: each map fills 16 MiB exactly, and Dr.Jit rounds its memory up to powers of two."""

    def __init__(self, backend: str = "llvm", differentiable: bool = False) -> None:
        self.dr = drjit()
        module = importlib.import_module(f"drjit.{backend}.ad" if differentiable else f"drjit.{backend}")
        self.float, self.uint = module.Float32, module.UInt32

    def number(self, value: float) -> Any:
        """A number of the camera, as a constant."""
        return self.constant(value)

    def constant(self, value: float) -> Any:
        """One float32 that the kernel reads instead of holding."""
        return self.dr.opaque(self.float, within_float32(value))

    def from_numpy(self, values: Any, window: SensorWindow) -> Any:
        """One number per pixel; a line of columns or rows is looked up by each pixel's place."""
        single = _aligned(np.shape(values))
        np.minimum(values, BRIGHTEST, out=single, casting="same_kind")
        if single.size == 1:
            return self.constant(float(single.ravel()[0]))
        if single.shape == window.shape:
            return self.float(single.ravel())
        column, row = self._coordinates(window)
        return self.dr.gather(self.float, self.float(single.ravel()), column if single.shape[0] == 1 else row)

    def to_numpy(self, signal: Any, window: SensorWindow) -> NDArray[Any]:
        """Runs the kernel and waits for it."""
        if isinstance(signal, float | int | np.ndarray):
            return np.broadcast_to(np.asarray(signal), window.shape)
        found = signal.numpy()
        return np.broadcast_to(found[0], window.shape) if found.size == 1 else found.reshape(window.shape)

    def job(self, signal: Any, window: SensorWindow, out: NDArray[Any]) -> Job:
        """One launch of the kernel."""
        return Launch(self.dr, self.uint(signal), out)

    def evaluate(self, window: SensorWindow) -> None:
        """All maps of the device in one kernel, columns and rows too: a look-up is slower than a load."""
        self.dr.eval([x for x in window.maps_made.values() if isinstance(x, self.float)])

    def random_bits(self, number: int, window: SensorWindow, frame: int, key: int) -> tuple[Any, Any, Any, Any]:
        """The four words of block ``number`` for every pixel of the window."""
        column, row = self._coordinates(window)
        x, y = column + self._whole(window.origin[1]), row + self._whole(window.origin[0])
        low, high = (self._whole(half) for half in split_key(key))
        return philox((x, y, self._whole(frame), self.uint(number)), (low, high))

    def poisson(self, bits: Any, mean: Any) -> Any:
        """Poisson counts about ``mean``, one or one per pixel."""
        every = self.dr.zeros(self.float, len(bits))  # a branch is as long as its condition, not as its arguments
        return poisson(bits, self.float(mean) + every)

    def _whole(self, value: int) -> Any:
        return self.dr.opaque(self.uint, value)

    def _coordinates(self, window: SensorWindow) -> tuple[Any, Any]:
        """Column and row of every pixel in the window: a division by the width through a product with 2³²/width."""
        return window.once("coordinates", lambda: self._divided(*window.shape))

    def _divided(self, height: int, width: int) -> tuple[Any, Any]:
        number = self.dr.arange(self.uint, height * width)
        if width == 1:
            return number * 0, number
        across = self._whole(width)
        row = self.dr.mul_hi(number, self._whole(2**32 // width))  # this or one too few
        column = number - row * across
        short = column >= across
        return self.dr.select(short, column - across, column), self.dr.select(short, row + 1, row)


def _aligned(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """An array that starts where a vector may: Dr.Jit reads it in place, by another kernel where it does not."""
    size = math.prod(shape)
    memory = np.empty(size + 16, dtype=np.float32)
    start = -memory.ctypes.data % 64 // 4
    return memory[start : start + size].reshape(shape)


class Launch(Job):
    """A kernel that other threads run while this one traces the next, or narrows the codes of the one before.

    Dr.Jit knows no 16-bit numbers, so the host makes them. To ask for an array waits for *all* kernels: therefore the
    next is launched after the wait for this one, and before its numbers are copied.
    """

    def __init__(self, dr: Any, codes: Any, out: NDArray[Any]) -> None:
        self.dr, self.codes, self.out = dr, codes, out

    def launch(self) -> None:
        self.dr.eval(self.codes)

    def wait(self) -> None:
        self.computed = self.codes.numpy()

    def deliver(self) -> None:
        np.copyto(self.out, self.computed.reshape(self.out.shape), casting="unsafe")
