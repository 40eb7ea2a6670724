"""Who does the arithmetic on pixels: NumPy in float64 (the reference), NumPy in float32, or one compiled kernel.

All ask the same words (words.py). The two float32 engines share every formula (quantiles.py) and agree bit for bit; the
reference asks SciPy's exact quantile functions (draws.py) and says how far float32 is off.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import arrays, draws, quantiles
from .words import block

if TYPE_CHECKING:
    from .frame import Device

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


class Lanes:
    """What an engine must offer; this one is the reference: NumPy, float64, the exact quantile of every law."""

    precision: Literal["float32", "float64"] = "float64"
    on_host: bool = True
    strip: int = 2**17
    """Pixels that are in flight at a time. Fewer, and threads wait for each other at every operation; more, and what
    they need leaves the cache."""

    def number(self, value: float) -> Any:
        """A number of the camera, as it meets the pixels."""
        return value

    def take(self, values: Any, device: Device) -> Any:
        """Numbers of the host, (H, W), (1, W), (H, 1) or one, as this engine holds them; none is above 1e30."""
        return np.minimum(np.asarray(values, dtype=np.float64), BRIGHTEST)

    def give(self, signal: Any, device: Device) -> NDArray[Any]:
        """What the engine holds, as an array (H, W) of the host."""
        return np.broadcast_to(np.asarray(signal), device.shape)

    def job(self, signal: Any, device: Device, out: NDArray[Any]) -> Job:
        """How to get digital numbers into ``out``, (H, W) of a whole-number type."""
        out[...] = signal
        return Job()

    def settle(self, device: Device) -> None:
        """Compute the device's maps now, once."""

    def block(self, number: int, device: Device, frame: int, key: int) -> tuple[Any, Any, Any, Any]:
        """The four words of block ``number`` for every pixel of the window."""
        return block(number, device.rows, device.columns, frame, key)

    def uniform(self, words: Any) -> Any:
        """(word + ½)/2³²."""
        return draws.survival(words)

    def normal(self, words: Any) -> Any:
        """Standard normal, mean 0 and variance 1."""
        return draws.normal(words)

    def normal_of(self, survival_probability: Any) -> Any:
        """The standard normal above which this share of the draws lies."""
        return draws.normal_of(survival_probability)

    def lognormal(self, words: Any, cv: float) -> Any:
        """Log-normal of mean 1."""
        return draws.lognormal(words, cv)

    def gamma(self, words: Any, cv: float) -> Any:
        """Gamma of mean 1."""
        return draws.gamma(words, cv)

    def logistic(self, words: Any) -> Any:
        """Standard logistic, variance π²/3."""
        return draws.logistic(words)

    def wald(self, z: Any, pick: Any, cv: float) -> Any:
        """Inverse Gaussian of mean 1, from a normal and a uniform."""
        return draws.wald(z, pick, cv)

    def poisson(self, words: Any, mean: Any) -> Any:
        """Poisson counts about ``mean``, one or one per pixel."""
        return draws.poisson(words, mean)

    def bernoulli(self, words: Any, chance: Any) -> Any:
        """1 with this ``chance``, one per pixel, else 0."""
        return arrays.where(self.uniform(words) < chance, 1.0, chance * 0.0)


class Single(Lanes):
    """NumPy in float32, one row strip at a time: every draw by the quantile functions of quantiles.py."""

    precision: Literal["float32", "float64"] = "float32"

    def number(self, value: float) -> Any:
        """The nearest float32."""
        return np.float32(held(value))

    def take(self, values: Any, device: Device) -> Any:
        """The nearest float32s."""
        return np.minimum(values, BRIGHTEST).astype(np.float32)

    def uniform(self, words: Any) -> Any:
        return quantiles.uniform(words)

    def normal(self, words: Any) -> Any:
        return quantiles.normal(words)

    def normal_of(self, survival_probability: Any) -> Any:
        return quantiles.normal_of(survival_probability)

    def lognormal(self, words: Any, cv: float) -> Any:
        variance = math.log1p(cv * cv)
        return quantiles.lognormal(words, self.number(math.sqrt(variance)), self.number(0.5 * variance))

    def gamma(self, words: Any, cv: float) -> Any:
        series = draws.gamma_series(cv, quantiles.CURVE_REACH, quantiles.CURVE_TERMS)
        return quantiles.curve(words, [self.number(c) for c in series])

    def logistic(self, words: Any) -> Any:
        return quantiles.logistic(words)

    def wald(self, z: Any, pick: Any, cv: float) -> Any:
        return quantiles.wald(z, pick, self.number(cv))

    def poisson(self, words: Any, mean: Any) -> Any:
        return quantiles.poisson(words, np.broadcast_to(np.asarray(mean, dtype=np.float32), words.shape))


def held(value: float) -> float:
    """A number that float32 can hold with room to multiply: between −1e30 and 1e30."""
    return min(max(value, -BRIGHTEST), BRIGHTEST)


REFERENCE, SINGLE = Lanes(), Single()


def normals(lanes: Lanes, words: Any) -> Any:
    """The plainest pattern: standard normals."""
    return lanes.normal(words)


def uniforms(lanes: Lanes, words: Any) -> Any:
    """Survival probabilities between 0 and 1."""
    return lanes.uniform(words)
