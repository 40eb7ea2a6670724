"""Who does the arithmetic on pixels: NumPy in float64 (the reference), NumPy in float32, or one compiled kernel.

All ask the same words (words.py). The two float32 engines share every formula (quantiles.py) and agree bit for bit; the
reference asks SciPy's exact quantile functions (draws.py) and says how far float32 is off.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import arrays, counter_rng, distributions, quantiles

if TYPE_CHECKING:
    from .sensor_window import SensorWindow

BRIGHTEST = 1e30
"""Means above this, and +inf, are taken for it: every well overflows long before, and no infinity meets a zero."""


class Job:
    """A strip's digital numbers on their way. On the host they have arrived, and there is nothing to do."""

    def launch(self) -> None:
        """Let others begin to compute them."""

    def wait(self) -> None:
        """Until they are computed."""

    def deliver(self) -> None:
        """Put them where they are wanted."""


class Backend:
    """What an engine must offer; this one is the reference: NumPy, float64, the exact quantile of every law."""

    precision: Literal["float32", "float64"] = "float64"
    on_host: bool = True
    strip: int = 2**17
    """Pixels that are in flight at a time. Fewer, and threads wait for each other at every operation; more, and what
    they need leaves the cache."""

    def number(self, value: float) -> Any:
        """A number of the camera, as it meets the pixels."""
        return value

    def from_numpy(self, values: Any, window: SensorWindow) -> Any:
        """Numbers of the host, (H, W), (1, W), (H, 1) or one, as this engine holds them; none is above 1e30."""
        return np.minimum(np.asarray(values, dtype=np.float64), BRIGHTEST)

    def to_numpy(self, signal: Any, window: SensorWindow) -> NDArray[Any]:
        """What the engine holds, as an array (H, W) of the host."""
        return np.broadcast_to(np.asarray(signal), window.shape)

    def job(self, signal: Any, window: SensorWindow, out: NDArray[Any]) -> Job:
        """How to get digital numbers into ``out``, (H, W) of a whole-number type."""
        out[...] = signal
        return Job()

    def evaluate(self, window: SensorWindow) -> None:
        """Compute the device's maps now, once."""

    def random_bits(self, number: int, window: SensorWindow, frame: int, key: int) -> tuple[Any, Any, Any, Any]:
        """The four words of block ``number`` for every pixel of the window."""
        return counter_rng.random_bits(number, window.rows, window.columns, frame, key)

    def uniform(self, bits: Any) -> Any:
        """(word + ½)/2³²."""
        return distributions.survival(bits)

    def normal(self, bits: Any) -> Any:
        """Standard normal, mean 0 and variance 1."""
        return distributions.normal(bits)

    def normal_of(self, survival_probability: Any) -> Any:
        """The standard normal above which this share of the draws lies."""
        return distributions.normal_of(survival_probability)

    def lognormal(self, bits: Any, cv: float) -> Any:
        """Log-normal of mean 1."""
        return distributions.lognormal(bits, cv)

    def gamma(self, bits: Any, cv: float) -> Any:
        """Gamma of mean 1."""
        return distributions.gamma(bits, cv)

    def logistic(self, bits: Any) -> Any:
        """Standard logistic, variance π²/3."""
        return distributions.logistic(bits)

    def wald(self, z: Any, pick: Any, cv: float) -> Any:
        """Inverse Gaussian of mean 1, from a normal and a uniform."""
        return distributions.wald(z, pick, cv)

    def poisson(self, bits: Any, mean: Any) -> Any:
        """Poisson counts about ``mean``, one or one per pixel."""
        return distributions.poisson(bits, mean)

    def bernoulli(self, bits: Any, chance: Any) -> Any:
        """1 with this ``chance``, one per pixel, else 0."""
        return arrays.where(self.uniform(bits) < chance, 1.0, chance * 0.0)


class NumpyFloat32(Backend):
    """NumPy in float32, one row strip at a time: every draw by the quantile functions of quantiles.py."""

    precision: Literal["float32", "float64"] = "float32"

    def number(self, value: float) -> Any:
        """The nearest float32."""
        return np.float32(within_float32(value))

    def from_numpy(self, values: Any, window: SensorWindow) -> Any:
        """The nearest float32s."""
        return np.minimum(values, BRIGHTEST).astype(np.float32)

    def uniform(self, bits: Any) -> Any:
        return quantiles.uniform(bits)

    def normal(self, bits: Any) -> Any:
        return quantiles.normal(bits)

    def normal_of(self, survival_probability: Any) -> Any:
        return quantiles.normal_of(survival_probability)

    def lognormal(self, bits: Any, cv: float) -> Any:
        variance = math.log1p(cv * cv)
        return quantiles.lognormal(bits, self.number(math.sqrt(variance)), self.number(0.5 * variance))

    def gamma(self, bits: Any, cv: float) -> Any:
        series = distributions.gamma_series(cv, quantiles.CURVE_REACH, quantiles.CURVE_TERMS)
        return quantiles.curve(bits, [self.number(c) for c in series])

    def logistic(self, bits: Any) -> Any:
        return quantiles.logistic(bits)

    def wald(self, z: Any, pick: Any, cv: float) -> Any:
        return quantiles.wald(z, pick, self.number(cv))

    def poisson(self, bits: Any, mean: Any) -> Any:
        return quantiles.poisson(bits, np.broadcast_to(np.asarray(mean, dtype=np.float32), bits.shape))


def within_float32(value: float) -> float:
    """A number that float32 can hold with room to multiply: between −1e30 and 1e30."""
    return min(max(value, -BRIGHTEST), BRIGHTEST)


NUMPY_FLOAT64, NUMPY_FLOAT32 = Backend(), NumpyFloat32()


def normals(backend: Backend, bits: Any) -> Any:
    """The plainest pattern: standard normals."""
    return backend.normal(bits)


def uniforms(backend: Backend, bits: Any) -> Any:
    """Survival probabilities between 0 and 1."""
    return backend.uniform(bits)
