"""Backends that compute pixels: NumPy in float64 (the reference) and in float32; drjit_backend.py has the third.

All backends draw the same random bits (counter_rng.py). The two float32 backends share their formulas (quantiles.py)
and agree bit for bit. The reference uses SciPy's quantile functions (distributions.py) and reveals the float32 error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

import numpy as np

from . import arrays, distributions, quantiles
from .counter_rng import random_bits_at
from .types import Array, Float32Array, NumpyArray

if TYPE_CHECKING:
    from .noise_distributions import NoiseDistribution
    from .sensor_window import SensorWindow

FLOAT32_LIMIT = 1e30
"""Larger numbers and +inf are clipped here; every pixel saturates long before, and ∞·0 cannot occur."""


class PendingStrip:
    """Digital numbers of a row strip that a backend may still be computing; NumPy has computed them.

    counts : name of a mask → its number of pixels, after the copy.
    """

    counts: Mapping[str, int] = MappingProxyType({})

    def launch(self) -> None:
        """Start the computation in other threads."""

    def wait(self) -> None:
        """Wait until they are computed."""

    def copy(self) -> None:
        """Copy them to the output array."""


class Backend:
    """The reference backend: NumPy, float64, exact quantile functions.

    compiled : the stages are traced once and run as a kernel, not computed step by step.
    bytes_of_numpy : the digital numbers equal NumPy's in the same precision, byte for byte.
    strip_pixels : computed at a time. With fewer, threads wait for each other; with more, arrays leave the cache.
    """

    precision: Literal["float32", "float64"] = "float64"
    compiled: bool = False
    bytes_of_numpy: bool = True
    strip_pixels: int = 2**17

    def number(self, value: float) -> Array:
        """Return a camera parameter in the precision of the pixels."""
        return value

    def from_numpy(self, values: Array, window: SensorWindow) -> Array:
        """Return NumPy values, shape (H, W), (1, W), (H, 1) or one value, as this backend's array, at most 1e30."""
        return np.minimum(np.asarray(values, dtype=np.float64), FLOAT32_LIMIT)

    def to_numpy(self, signal: Array, window: SensorWindow) -> NumpyArray:
        """Return an array of this backend as a NumPy array (H, W)."""
        return np.broadcast_to(np.asarray(signal), window.shape)

    def neighbour(self, signal: Array, window: SensorWindow, rows: int, columns: int) -> Array:
        """Return the signal of the pixels this many rows below and columns to the right; edge pixels repeat."""
        below = np.clip(np.arange(window.shape[0]) + rows, 0, window.shape[0] - 1)
        right = np.clip(np.arange(window.shape[1]) + columns, 0, window.shape[1] - 1)
        return np.broadcast_to(signal, window.shape)[np.ix_(below, right)]

    def pending(
        self, signal: Array, window: SensorWindow, out: NumpyArray, masks: Mapping[str, Array]
    ) -> PendingStrip:
        """Write digital numbers into ``out``, integers (H, W), and count the pixels of masks."""
        out[...] = signal
        done = PendingStrip()
        done.counts = {
            name: int(np.count_nonzero(np.broadcast_to(mask, out.shape)))
            for name, mask in masks.items()
        }
        return done

    def evaluate(self, window: SensorWindow) -> None:
        """Compute the FPN maps of the window now."""

    def random_bits(
        self, block: int, window: SensorWindow, frame: int, key: int
    ) -> tuple[Array, Array, Array, Array]:
        """Return four random 32-bit integers of ``block`` for every pixel of the window."""
        return random_bits_at(block, window.rows[:, None], window.columns[None, :], frame, key)

    # Random bits to random numbers: uniform between 0 and 1; standard normal, also from a survival probability;
    # log-normal, gamma and inverse Gaussian (Wald) of mean 1 and given coefficient of variation; standard logistic and
    # Moyal.
    uniform = staticmethod(distributions.survival)
    normal = staticmethod(distributions.normal)
    normal_of = staticmethod(distributions.normal_of)
    lognormal = staticmethod(distributions.lognormal)
    gamma = staticmethod(distributions.gamma)
    logistic = staticmethod(distributions.logistic)
    moyal = staticmethod(distributions.moyal)
    wald = staticmethod(distributions.wald)

    def distributed(self, bits: Array, distribution: NoiseDistribution) -> Array:
        """Return numbers of mean 0 and variance 1 with this distribution."""
        return distribution.quantile(distributions.survival(bits))

    def poisson(self, bits: Array, mean: Array) -> Array:
        """Return Poisson counts of this ``mean``, one for all or one per pixel."""
        return distributions.poisson(bits, mean)

    def gamma_of_shape(self, bits: Array, shape: Array) -> Array:
        """Return gamma numbers with mean and variance ``shape``, one per pixel."""
        return distributions.gamma_of_shape(bits, shape)

    def split(
        self, bits: Array, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        """Split Poisson counts of mean light + dark into two independent counts, by binomial thinning."""
        counted = distributions.binomial(bits, count, dark, light)
        return count - counted, counted

    def bernoulli(self, bits: Array, probability: Array) -> Array:
        """Return 1 with this ``probability``, one per pixel, else 0."""
        return arrays.where(self.uniform(bits) < probability, 1.0, probability * 0.0)


class NumpyFloat32(Backend):
    """NumPy in float32, with the quantile functions of quantiles.py."""

    precision: Literal["float32", "float64"] = "float32"

    def number(self, value: float) -> Array:
        """Return the nearest float32."""
        return np.float32(within_float32(value))

    def from_numpy(self, values: Array, window: SensorWindow) -> Array:
        """Return the nearest float32 values."""
        single = np.empty(np.shape(values), dtype=np.float32)
        return np.minimum(values, FLOAT32_LIMIT, out=single, casting="same_kind")

    uniform = staticmethod(quantiles.uniform)
    normal = staticmethod(quantiles.normal)
    normal_of = staticmethod(quantiles.normal_of)
    logistic = staticmethod(quantiles.logistic)
    moyal = staticmethod(quantiles.moyal)

    def lognormal(self, bits: Array, cv: float) -> Array:
        variance = math.log1p(cv * cv)
        parameters = map(self.number, (math.sqrt(variance), 0.5 * variance))
        return quantiles.lognormal(bits, *parameters)

    def gamma(self, bits: Array, cv: float) -> Array:
        series = distributions.gamma_series(
            cv, quantiles.CHEBYSHEV_REACH, quantiles.CHEBYSHEV_TERMS
        )
        return quantiles.exp_chebyshev(bits, [self.number(c) for c in series])

    def distributed(self, bits: Array, distribution: NoiseDistribution) -> Array:
        return quantiles.stretched_normal(bits, [self.number(c) for c in distribution.series])

    def gamma_of_shape(self, bits: Array, shape: Array) -> Array:
        series = distributions.gamma_shape_series(
            quantiles.CHEBYSHEV_REACH, *quantiles.GAMMA_TERMS
        )
        return quantiles.gamma_of_shape(bits, shape, series)

    def wald(self, z: Array, u: Array, cv: float) -> Array:
        return quantiles.wald(z, u, self.number(cv))

    def poisson(self, bits: Array, mean: Array) -> Array:
        mean = np.broadcast_to(np.asarray(mean, dtype=np.float32), bits.shape)
        return quantiles.poisson(bits, mean)

    def split(
        self, bits: Array, count: Array, light: Array, dark: Array
    ) -> tuple[Array, Array]:
        means = (
            np.broadcast_to(np.asarray(x, dtype=np.float32), bits.shape)
            for x in (count, dark, light)
        )
        counted = quantiles.binomial(bits, *means)
        return count - counted, counted


def aligned_float32(shape: tuple[int, ...]) -> Float32Array:
    """Return an empty array aligned to 64 bytes, which Dr.Jit reads in place with the same kernel."""
    size = math.prod(shape)
    memory = np.empty(size + 16, dtype=np.float32)
    start = -memory.ctypes.data % 64 // 4
    return memory[start : start + size].reshape(shape)


def within_float32(value: float) -> float:
    """Return ``value`` clipped to ±1e30, so its float32 products stay finite."""
    return min(max(value, -FLOAT32_LIMIT), FLOAT32_LIMIT)


NUMPY_FLOAT64, NUMPY_FLOAT32 = Backend(), NumpyFloat32()


def normals(backend: Backend, bits: Array) -> Array:
    """Return standard normals, as the distribution of an FPN map."""
    return backend.normal(bits)


def uniforms(backend: Backend, bits: Array) -> Array:
    """Return uniforms between 0 and 1, as the distribution of an FPN map."""
    return backend.uniform(bits)
