"""Dr.Jit backend with derivatives: the same values, and how they change with the camera and with the photons.

Random numbers and the ADC are step functions. Their values stay, and their derivatives are chosen such that mean and
variance have the right derivatives:

    Poisson     n of mean λ: dn/dλ = (1 + n/λ)/2, for E[dn] = dλ and E[2n·dn] = d(λ + λ²)
    Bernoulli   b of probability p: db/dp = 1/(2p) where it is 1, 1/(2(1 − p)) where 0, for E[db] = dp and E[2b·db] = dp
    Wald        x of coefficient of variation c: dx/dc = (x − 1)/c, for E[dx] = 0 and E[2x·dx] = d(c²)
    ADC         codes per DN about the signal, or the slope of E[code] where the noise is small (code_slope.py)

Normal, log-normal, gamma and logistic are smooth functions of their parameters.
"""

import importlib
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from . import arrays
from .backend import NumpyFloat32
from .drjit_backend import DrJitBackend
from .quantiles import wald
from .sensor_window import SensorWindow
from .types import Array

NEVER_COUNTED = (
    2.0**-32
)  # a Poisson mean below which the count is always 0, so that n/λ is set to its mean, 1
SLOTS = 512  # partial sums per parameter in which the threads add up derivatives in float32


@dataclass(frozen=True)
class CameraNumber:
    """A number that the camera passes to the kernel, and its derivatives by parameter name, where not 0."""

    value: float
    slopes: dict[str, float] = field(default_factory=dict)


class RecordingBackend(NumpyFloat32):
    """NumPy in float32 that records every number of the camera that the stages use, in their order."""

    def __init__(self) -> None:
        self.numbers: list[float] = []

    def number(self, value: float) -> Array:
        """The nearest float32."""
        self.numbers.append(float(value))
        return super().number(value)

    def random_bits(
        self, block: int, window: SensorWindow, frame: int, key: int
    ) -> tuple[Array, Array, Array, Array]:
        """The median everywhere: the random numbers do not matter."""
        bits = np.full(window.shape, 2**31, dtype=np.uint32)
        return bits, bits, bits, bits


class DifferentiableBackend(DrJitBackend):
    """Dr.Jit in float32, with derivatives.  numbers : all of the camera, in the order in which the stages use them.

    size : pixels, or 1 while the FPN maps are computed.  start : index of the number that is used next.
    random_numbers : those drawn in a frame. Once they are evaluated, derivatives cost little more.
    """

    def __init__(
        self, backend: str, numbers: Sequence[CameraNumber], size: int = 1, start: int = 0
    ) -> None:
        super().__init__(backend, differentiable=True)
        self._numbers, self._size, self._next = numbers, size, start
        self._constant = False
        self._packets = importlib.import_module(self.float.__module__).ArrayXf
        self._leaves: list[tuple[Array, Mapping[str, Array]]] = []
        self._maps: dict[Hashable, tuple[Array, dict[str, Array]]] = {}
        self.random_numbers: list[Array] = []

    def with_slopes(self, value: Array, slopes: Mapping[str, Array]) -> Array:
        """``value`` with these derivatives by parameter name: one number, or one per pixel."""
        if not slopes:
            return value
        # The result depends on a leaf of the graph of derivatives: zeros, one per pixel, so that no kernel sums pixels.
        leaf = self.dr.zeros(self.float, self._size)
        self.dr.enable_grad(leaf)
        self._leaves.append((leaf, slopes))
        return self.dr.replace_grad(value, leaf)

    def backward(self, loss: Array) -> dict[str, Array]:
        """d Σloss/d parameter, one number per pixel, not evaluated yet."""
        dr, found = self.dr, dict[str, Array]()
        dr.backward(loss, flags=dr.ADFlag.ClearVertices)
        for leaf, slopes in self._leaves:
            for name, slope in slopes.items():
                part = dr.grad(leaf) * slope
                found[name] = found[name] + part if name in found else part
            dr.clear_grad(leaf)
        return found

    def forward(self, name: str, *outputs: Array) -> list[Array]:
        """d output/d parameter ``name`` of each output, not evaluated yet."""
        dr = self.dr
        for leaf, slopes in self._leaves:
            if name in slopes:
                dr.set_grad(leaf, slopes[name])
                dr.enqueue(dr.ADMode.Forward, leaf)
        dr.traverse(dr.ADMode.Forward, dr.ADFlag.ClearVertices)
        found = [dr.grad(x) for x in outputs]
        dr.clear_grad(outputs)
        return found

    def number(self, value: float) -> Array:
        """One float32 that the kernel reads as data, with the derivatives of the next of the recorded numbers."""
        known = self._numbers[self._next]
        self._next += 1
        assert known.value == float(value), (
            "the stages use the numbers of the camera in another order than recorded"
        )
        if self._constant:
            return super().number(value)
        slopes = {
            name: super(DifferentiableBackend, self).number(slope)
            for name, slope in known.slopes.items()
        }
        return self.with_slopes(super().number(value), slopes)

    @property
    def place(self) -> int:
        """Index of the number that is used next."""
        return self._next

    @contextmanager
    def again(self, place: int, derivatives: bool = False) -> Iterator[None]:
        """Run stages another time, from this place on; without derivatives by the numbers unless asked for."""
        after, self._next, self._constant = self._next, place, not derivatives
        try:
            yield
        finally:
            self._next, self._constant = after, False

    def normal(self, bits: Array) -> Array:
        """Standard normal, mean 0 and variance 1."""
        self.random_numbers.append(super().normal(bits))
        return self.random_numbers[-1]

    def poisson(self, bits: Array, mean: Array) -> Array:
        """Poisson counts of this ``mean``, one for all or one per pixel."""

        count = arrays.with_derivative_of(
            self._line, partial(super().poisson, bits), self.float(mean)
        )
        self.random_numbers.append(self.dr.detach(count))
        return count

    def split(
        self, bits: Array, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        """A Poisson count of mean light + dark in two, each with the derivatives of its own law."""
        means = self.float(light), self.float(dark)
        counts = super().split(bits, *(self.dr.detach(x) for x in (count, *means)))
        self.random_numbers += counts
        return tuple(
            arrays.with_gradient(n, self._line, m, n)
            for n, m in zip(counts, means, strict=True)
        )

    def _line(self, mean: Array, count: Array) -> Array:
        fixed = self.dr.detach(mean)
        return mean * (0.5 + 0.5 * arrays.where(fixed > NEVER_COUNTED, count / fixed, 1.0))

    def bernoulli(self, bits: Array, probability: Array) -> Array:
        """1 with this ``probability``, one per pixel, else 0."""

        def surrogate(probability: Array, happened: Array) -> Array:
            fixed = self.dr.detach(probability)
            return probability * (
                0.5
                / arrays.maximum(arrays.where(happened > 0, fixed, 1.0 - fixed), NEVER_COUNTED)
            )

        return arrays.with_derivative_of(
            surrogate, partial(super().bernoulli, bits), probability
        )

    def wald(self, z: Array, u: Array, cv: float) -> Array:
        """Inverse Gaussian of mean 1, from a normal and a uniform."""
        return arrays.with_derivative_of(
            lambda c, x: c * ((x - 1.0) / self.dr.detach(c)),
            partial(wald, z, u),
            self.number(cv),
        )

    def evaluate(self, window: SensorWindow) -> None:
        """Compute all FPN maps of the window and their derivatives, once."""
        dr, maps = (
            self.dr,
            {key: x for key, x in window.cached_values.items() if isinstance(x, self.float)},
        )
        self._maps = {key: (dr.detach(x), {}) for key, x in maps.items()}
        for name in dict.fromkeys(name for _, slopes in self._leaves for name in slopes):
            for key, slope in zip(maps, self.forward(name, *maps.values()), strict=True):
                if slope.state != dr.VarState.Literal:  # else 0: the map does not depend on it
                    self._maps[key][1][name] = slope
        dr.eval(list(self._maps.values()))

    def renewed(self, window: SensorWindow) -> tuple["DifferentiableBackend", SensorWindow]:
        """A backend with new leaves for one frame, and the window whose FPN maps depend on them."""
        height, width = window.shape
        backend = DifferentiableBackend(
            self._backend, self._numbers, height * width, self._next
        )
        return backend, self._moved_to(backend, window)

    def attached(
        self, window: SensorWindow, changes: Mapping[str, Array]
    ) -> tuple["AttachedBackend", SensorWindow]:
        """A backend whose results depend on variables of somebody else's graph of derivatives, and its window.

        changes : by parameter name, a variable minus its value: 0, with the derivative 1.
        """
        height, width = window.shape
        backend = AttachedBackend(self._backend, self._numbers, height * width, self._next)
        backend.changes = changes
        return backend, self._moved_to(backend, window)

    def _moved_to(self, backend: "DifferentiableBackend", window: SensorWindow) -> SensorWindow:
        """The window on another backend, with the derivatives of its FPN maps there."""
        maps = {key: backend.with_slopes(x, slopes) for key, (x, slopes) in self._maps.items()}
        return replace(window, backend=backend, _maps={**window.cached_values, **maps})

    def unused(self) -> "DifferentiableBackend":
        """One for another window of the same camera."""
        return DifferentiableBackend(self._backend, self._numbers)

    def totals(self, pixels: Mapping[str, Array]) -> Array:
        """Sums over all pixels, not evaluated yet: (SLOTS, W) as one array, a column per name and W a power of two.

        Every thread adds packets of one number per name to slots of its own, in the kernel that computes them, so the
        pixels are not written to memory; eight neighbours use eight slots, so that no addition waits for another.
        """
        dr, width = self.dr, 1 << (len(pixels) - 1).bit_length()
        sums, pixel = dr.zeros(self.float, SLOTS * width), dr.arange(self.uint, self._size)
        slot = (((pixel >> 12) << 3) | (pixel & 7)) & (SLOTS - 1)
        parts = [dr.detach(x) for x in pixels.values()] + [self.float(0)] * (
            width - len(pixels)
        )
        dr.scatter_add(sums, self._packets(parts), slot, mode=dr.ReduceMode.Expand)
        return sums


class AttachedBackend(DifferentiableBackend):
    """Dr.Jit in float32 as a part of a graph of derivatives that somebody else has begun, and goes through.

    changes : by parameter name, a variable of that graph minus its value.
    """

    changes: Mapping[str, Array]

    def with_slopes(self, value: Array, slopes: Mapping[str, Array]) -> Array:
        """``value`` with these derivatives by parameter name."""
        for name, slope in slopes.items():
            value = value + slope * self.changes[name]
        return value
