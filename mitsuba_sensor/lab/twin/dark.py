"""Black level, offsets and dark current: each pixel's mean in the dark as a line over the exposure time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ..frames.series import ROUNDING_DN2
from ..frames.stack import Stack
from ..measure.dark_current import errors_of_means
from ..quantity import Quantity, normal_interval, student_interval, unknown
from ..statistics.families import FAMILIES
from ..statistics.mean_squares import MeanSquares, temporal_mean_squares
from .combined_map import CombinedMap, Noise
from .evidence import Fitted, frames_of
from .parabola import straight

SECTION = "fit"
FAMILY_NAMES = {
    "normal": "gaussian",
    "log-normal": "lognormal",
    "gamma": "gamma",
    "inverse Gaussian": "wald",
}
"""Distributions of the laboratory → those of a camera file."""
EXCESS: dict[str, Callable[[float], float]] = {
    "gaussian": lambda cv: 0.0,
    "lognormal": lambda cv: (1 + cv**2) ** 4 + 2 * (1 + cv**2) ** 3 + 3 * (1 + cv**2) ** 2 - 6,
    "gamma": lambda cv: 6 * cv**2,
    "wald": lambda cv: 15 * cv**2,
}
"""Excess kurtosis: a sample variance is as many halves of it less certain than of normal values, in variance."""
CLEAR = 3.0
"""Spread of the dark current over what averaging left of noise, from which on its distribution is looked at."""
SAME_S = 0.01
"""Exposure times up to this above the shortest are as good for the read noise [s]."""
NOTED_DN = 1e-3
"""Shift of the black level from which on rounding is noted."""
MOST_VALUES = 2**18
NEGATIVE = 5e-3
"""Share of pixels without a positive dark current, above which no distribution of positive values is compared."""


@dataclass(frozen=True, eq=False)
class Dark:
    """What dark frames of one temperature and gain show.

    black : code of darkness at exposure time 0 [DN].  offsets : of the pixels there [DN].
    rate : mean dark signal [DN/s].  cv : its σ over mean from pixel to pixel.  rates : of the pixels [DN/s], or None.
    family : distribution of the rates, None where it is not told apart.
    quiet : the stack that shows the temporal noise, and its mean squares.  notes : what restricts all of them.
    """

    black: Fitted
    offsets: CombinedMap
    rate: Fitted
    cv: Fitted
    rates: CombinedMap | None
    family: str | None
    quiet: Stack
    squares: MeanSquares
    notes: tuple[str, ...]

    def of(self, rows: slice, columns: slice) -> Dark:
        """Offsets and rates of some rows and columns; the temporal noise is that of all."""
        offsets = replace(self.offsets, image=self.offsets.image[rows, columns])
        rates = self.rates and replace(self.rates, image=self.rates.image[rows, columns])
        return replace(self, offsets=offsets, rates=rates)

    def at(self, exposure_s: float) -> Float64Array:
        """Expected mean frame of an exposure time (H, W) [DN]."""
        return (
            self.offsets.image
            if self.rates is None
            else self.offsets.image + exposure_s * self.rates.image
        )


def dark_over_time(stacks: Sequence[Stack], curvature: float = 0.0) -> Dark:
    """From bias and dark stacks of one temperature.  curvature : κ of the response [1/DN], for long exposures.

    Raises InputError where none has 2 frames inside of the range.
    """
    used, notes = usable(stacks)
    squares = [temporal_mean_squares(one) for one in used]
    pixel = np.array([max(sum(term.value for term in one.variance()), 1e-9) for one in squares])
    times, counts = (
        np.array([one.exposure_s for one in used]),
        np.array([len(one) for one in used]),
    )
    means = np.array([float(one.frame_means.mean()) for one in used])
    errors, freedom = errors_of_means(used, squares)
    quiet = min(range(len(used)), key=lambda k: (times[k] > times.min() + SAME_S, -counts[k]))
    bend = Bend(float(means[quiet]), curvature)
    means = bend.straight(means)
    at_zero, per_second = line_weights(times, counts / pixel)
    frames = frames_of(*used)
    black = Quantity(
        "black", "black level", *_sum(means, errors, at_zero, freedom), "DN", SECTION
    )
    rate = Quantity(
        "µ_I", "dark signal", *_sum(means, errors, per_second, freedom), "DN/s", SECTION
    )
    offsets = _combined(used, squares, at_zero, bend)
    rates = _combined(used, squares, per_second, bend) if per_second.any() else None
    if rates is None:
        why = "one exposure time: dark current is part of the black level"
        rate, black = unknown(rate, why), black.noted(why)
    elif rate.low <= 0:
        rate = replace(
            rate, value=max(rate.value, 0.0), low=0.0, high=max(rate.high, 0.0)
        ).noted("not told from 0")
    cv, family = _over_pixels(rates, rate)
    return Dark(
        Fitted(_marked(black, used[quiet], notes), frames),
        offsets,
        Fitted(rate, frames),
        Fitted(cv, frames),
        rates,
        family,
        used[quiet],
        squares[quiet],
        tuple(notes),
    )


def line_weights(
    times: Float64Array, weights: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """What a line through weighted points takes of each for its value at time 0, and for its slope (0 for one time)."""
    if len(set(times.tolist())) < 2:
        return weights / weights.sum(), np.zeros(len(times))
    s0, s1, s2 = (float((weights * times**power).sum()) for power in range(3))
    det = s0 * s2 - s1**2
    return weights * (s2 - s1 * times) / det, weights * (s0 * times - s1) / det


def usable(stacks: Sequence[Stack]) -> tuple[list[Stack], list[str]]:
    """Those with 2 frames or more and no clipped values, and notes on the others. Raises InputError where none is."""
    inside = [one for one in stacks if len(one) > 1 and one.clipping.usable]
    if not inside:
        found = "; ".join(
            f"{one.source}: {one.clipping.note or f'{len(one)} frame'}" for one in stacks[:3]
        )
        raise InputError(
            f"no dark stack has 2 frames or more inside of the ADC's range ({found}); take others."
        )
    left = [one for one in stacks if one not in inside]
    return inside, [
        f"{one.source} left out: {one.clipping.note or 'one frame'}" for one in left
    ]


def _sum(
    means: Float64Array, errors: Float64Array, weights: Float64Array, freedom: float
) -> tuple[float, float, float]:
    """A sum with weights of independent means."""
    value, error = float(weights @ means), math.sqrt(float(weights**2 @ errors**2))
    return (
        normal_interval(value, error)
        if math.isinf(freedom)
        else student_interval(value, error, freedom)
    )


def _marked(black: Quantity, quiet: Stack, notes: Sequence[str]) -> Quantity:
    """With what clipping and rounding do to it: the mean of rounded normal values is off by exp(−2π²σ²)/π at most."""
    for note in notes:
        black = black.noted(note)
    if quiet.frames.dtype.kind == "f":
        return black
    variance = max(float(quiet.variance.mean() + quiet.mean.var()) - ROUNDING_DN2, 0.0)
    bound = math.exp(-2 * math.pi**2 * variance) / math.pi
    if bound < NOTED_DN:
        return black
    wide = replace(black, low=black.low - bound, high=black.high + bound)
    return wide.noted(f"rounding may shift it by up to {bound:.2g} DN")


@dataclass(frozen=True)
class Bend:
    """A curved response above the black level [DN].  curvature : κ [1/DN]."""

    black: float
    curvature: float

    def straight(self, values: Float64Array) -> Float64Array:
        """As a linear response would have given."""
        return (
            self.black + straight(values - self.black, self.curvature)
            if self.curvature
            else values
        )


def _combined(
    stacks: Sequence[Stack], squares: Sequence[MeanSquares], weights: Float64Array, bend: Bend
) -> CombinedMap:
    image = np.zeros(stacks[0].shape)
    for stack, weight in zip(stacks, weights, strict=True):
        image += weight * bend.straight(stack.mean)
    noises = zip(squares, stacks, weights, strict=True)
    return CombinedMap(
        image, tuple(Noise(one, float(w**2) / len(stack)) for one, stack, w in noises if w)
    )


def _over_pixels(rates: CombinedMap | None, rate: Quantity) -> tuple[Quantity, str | None]:
    """cv and distribution of the rates of the pixels."""
    like = Quantity(
        "D_N", "non-uniformity of the dark current", math.nan, math.nan, math.nan, "", SECTION
    )
    if rates is None or not rate.low > 0:
        return unknown(like, "dark current is not told from 0"), None
    value, low, high = rates.spread()["all"]
    noise = math.sqrt(max(float(rates.image.var()) - value**2, 0.0))
    family = _family(rates.image) if low > 0 and value > CLEAR * noise else None
    wider = math.sqrt(1 + EXCESS[family](value / rate.value) / 2) if family else 1.0
    ends = (max(value + wider * (end - value), 0.0) for end in (low, high))
    cv = replace(like, value=value, low=next(ends), high=next(ends)).divided(rate, "")
    return cv if low > 0 else cv.noted("not told from 0"), family


def _family(image: Float64Array) -> str | None:
    """With the smallest BIC; all have two parameters."""
    values = image.ravel()[:: max(1, image.size // MOST_VALUES)]
    positive = values[values > 0]
    if 1 - positive.size / values.size > NEGATIVE:
        return None
    weights = np.ones(positive.size)
    found = {
        name: float(one.log_density(positive, one.fit(positive, weights)).sum())
        for name, one in FAMILIES.items()
    }
    return FAMILY_NAMES[max(found, key=lambda name: found[name])]
