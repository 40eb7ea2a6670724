"""The compiled engine with derivatives: the very same values, and how they change with the camera and with the light.

Draws and converters jump; their values stay, and their derivatives are such that mean and variance change rightly:

    Poisson     n of mean λ: dn/dλ = (1 + n/λ)/2, for E[dn] = dλ and E[2n·dn] = d(λ + λ²)
    Bernoulli   b of chance p: db/dp = 1/(2p) where it is 1, 1/(2(1 − p)) where 0, for E[db] = dp and E[2b·db] = dp
    Wald        x of coefficient of variation c: dx/dc = (x − 1)/c, for E[dx] = 0 and E[2x·dx] = d(c²)
    converter   that of the line which its steps follow: right as far as noise hides the steps

Normal, log-normal, gamma and logistic are smooth functions of the camera's numbers.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from . import arrays
from .backend import NumpyFloat32
from .drjit_backend import DrJitBackend
from .quantiles import wald
from .sensor_window import SensorWindow

COUNTABLE = 2.0**-32
"""A Poisson mean below which no word asks for a count, so that n/λ is taken for its mean, 1."""

SLOTS = 512
"""Numbers per name in which a thread adds up derivatives in float32."""


@dataclass(frozen=True)
class Number:
    """A number of the camera: its value, and its derivatives by the names of what it depends on, where not 0."""

    value: float
    slopes: dict[str, float] = field(default_factory=dict)


class Recorder(NumpyFloat32):
    """NumPy in float32 that writes down every number of the camera as it meets the pixels."""

    def __init__(self) -> None:
        self.numbers: list[float] = []

    def number(self, value: float) -> Any:
        """The nearest float32."""
        self.numbers.append(float(value))
        return super().number(value)

    def random_bits(self, number: int, window: SensorWindow, frame: int, key: int) -> tuple[Any, Any, Any, Any]:
        """The middle word everywhere: what is drawn does not matter."""
        bits = np.full(window.shape, 2**31, dtype=np.uint32)
        return bits, bits, bits, bits


class Differentiable(DrJitBackend):
    """Dr.Jit in float32, with derivatives.

    backend : "llvm" or "cuda".  numbers : all of the camera, in the order in which they meet the pixels.
    size : pixels, or 1 while the maps are made.  start : which number comes next.
    draws : what was drawn in a pass. Once they are computed, derivatives take little more.
    """

    def __init__(self, backend: str, numbers: Sequence[Number], size: int = 1, start: int = 0) -> None:
        super().__init__(backend, differentiable=True)
        self._backend, self._numbers, self._size, self._next = backend, numbers, size, start
        self._packets = importlib.import_module(self.float.__module__).ArrayXf
        self._leaves: list[tuple[Any, Mapping[str, Any]]] = []
        self._maps: dict[Any, tuple[Any, dict[str, Any]]] = {}
        self.distributions: list[Any] = []

    def follow(self, value: Any, slopes: Mapping[str, Any]) -> Any:
        """``value``, with these derivatives by name: one number, or one per pixel.

        What comes back hangs on a leaf: zeros, one per pixel, so that no kernel adds pixels up.
        """
        if not slopes:
            return value
        leaf = self.dr.zeros(self.float, self._size)
        self.dr.enable_grad(leaf)
        self._leaves.append((leaf, slopes))
        return self.dr.replace_grad(value, leaf)

    def backward(self, loss: Any) -> dict[str, Any]:
        """d Σloss/d name, one number per pixel, not computed yet."""
        dr, found = self.dr, dict[str, Any]()
        dr.backward(loss, flags=dr.ADFlag.ClearVertices)
        for leaf, slopes in self._leaves:
            for name, slope in slopes.items():
                part = dr.grad(leaf) * slope
                found[name] = found[name] + part if name in found else part
            dr.clear_grad(leaf)
        return found

    def forward(self, name: str, *outputs: Any) -> list[Any]:
        """d output/d name of each output, not computed yet."""
        dr = self.dr
        for leaf, slopes in self._leaves:
            if name in slopes:
                dr.set_grad(leaf, slopes[name])
                dr.enqueue(dr.ADMode.Forward, leaf)
        dr.traverse(dr.ADMode.Forward, dr.ADFlag.ClearVertices)
        found = [dr.grad(x) for x in outputs]
        dr.clear_grad(outputs)
        return found

    def number(self, value: float) -> Any:
        """One float32 that the kernel reads; it changes as the next of the numbers says."""
        known = self._numbers[self._next]
        self._next += 1
        assert known.value == float(value), "the numbers of the camera come in another order than recorded"
        return self.follow(self.constant(value), {name: self.constant(slope) for name, slope in known.slopes.items()})

    def normal(self, bits: Any) -> Any:
        """Standard normal, mean 0 and variance 1."""
        self.distributions.append(super().normal(bits))
        return self.distributions[-1]

    def poisson(self, bits: Any, mean: Any) -> Any:
        """Poisson counts about ``mean``, one or one per pixel."""
        count = arrays.along(self._poisson_line, partial(super().poisson, bits), self.float(mean))
        self.distributions.append(self.dr.detach(count))
        return count

    def _poisson_line(self, mean: Any, count: Any) -> Any:
        fixed = self.dr.detach(mean)
        return mean * (0.5 + 0.5 * arrays.where(fixed > COUNTABLE, count / fixed, 1.0))

    def bernoulli(self, bits: Any, chance: Any) -> Any:
        """1 with this ``chance``, one per pixel, else 0."""
        return arrays.along(self._bernoulli_line, partial(super().bernoulli, bits), chance)

    def _bernoulli_line(self, chance: Any, happened: Any) -> Any:
        fixed = self.dr.detach(chance)
        return chance * (0.5 / arrays.maximum(arrays.where(happened > 0, fixed, 1.0 - fixed), COUNTABLE))

    def wald(self, z: Any, pick: Any, cv: float) -> Any:
        """Inverse Gaussian of mean 1, from a normal and a uniform."""
        line = lambda spread, x: spread * ((x - 1.0) / self.dr.detach(spread))  # noqa: E731
        return arrays.along(line, partial(wald, z, pick), self.number(cv))

    def evaluate(self, window: SensorWindow) -> None:
        """All maps of the device, and their derivatives, computed once."""
        dr, maps = self.dr, {key: x for key, x in window.maps_made.items() if isinstance(x, self.float)}
        self._maps = {key: (dr.detach(x), {}) for key, x in maps.items()}
        for name in dict.fromkeys(name for _, slopes in self._leaves for name in slopes):
            for key, slope in zip(maps, self.forward(name, *maps.values()), strict=True):
                if slope.state != dr.VarState.Literal:  # a literal 0: the map does not depend on it
                    self._maps[key][1][name] = slope
        dr.eval(list(self._maps.values()))

    def renewed(self, window: SensorWindow) -> tuple[Differentiable, SensorWindow]:
        """Fresh leaves for one pass through the pixels, and the device with its maps hung on them."""
        height, width = window.shape
        backend = Differentiable(self._backend, self._numbers, height * width, self._next)
        maps = {key: backend.follow(x, slopes) for key, (x, slopes) in self._maps.items()}
        return backend, replace(window, backend=backend, _maps={**window.maps_made, **maps})

    def totals(self, pixels: Mapping[str, Any]) -> Any:
        """Sums over all pixels, not computed yet: (SLOTS, W) as one long array, a column per name and W a power of two.

        Every thread adds packets of one number per name to slots of its own, in the kernel that makes them, so that
        nothing goes through memory; eight neighbours go to eight slots, and none waits for the other.
        """
        dr, width = self.dr, 1 << (len(pixels) - 1).bit_length()
        sums, pixel = dr.zeros(self.float, SLOTS * width), dr.arange(self.uint, self._size)
        slot = (((pixel >> 12) << 3) | (pixel & 7)) & (SLOTS - 1)
        parts = [dr.detach(x) for x in pixels.values()] + [self.float(0)] * (width - len(pixels))
        dr.scatter_add(sums, self._packets(parts), slot, mode=dr.ReduceMode.Expand)
        return sums
