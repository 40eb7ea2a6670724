"""Black level, offsets and dark current: each pixel's mean in the dark as a line over the exposure time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ..frames.rounding import ROUNDING_DN2
from ..frames.stack import Stack
from ..measure.curved_response import straight
from ..measure.dark_current import errors_of_means
from ..quantity import Quantity, no_value, normal_interval, student_interval, unknown
from ..statistics.families import FAMILIES
from ..statistics.mean_squares import MeanSquares, temporal_mean_squares
from .combined_map import CombinedMap, Noise
from .evidence import Fitted, frames_of

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

    def window(self, rows: slice, columns: slice) -> Dark:
        """Offsets and rates of some rows and columns; the temporal noise is that of all."""
        offsets = replace(self.offsets, image=self.offsets.image[rows, columns])
        rates = self.rates
        if rates is not None:
            rates = replace(rates, image=rates.image[rows, columns])
        return replace(self, offsets=offsets, rates=rates)

    def expected_frame(self, exposure_s: float) -> Float64Array:
        """Expected mean frame of an exposure time (H, W) [DN]."""
        if self.rates is None:
            return self.offsets.image
        return self.offsets.image + exposure_s * self.rates.image


def dark_over_time(stacks: Sequence[Stack], curvature: float = 0.0) -> Dark:
    """Each pixel's line over time from bias and dark stacks of one temperature.

    curvature : κ of the response [1/DN], for long exposures.
    Raises InputError where no stack has 2 frames inside of the range.
    """
    used, notes = usable(stacks)
    squares = [temporal_mean_squares(stack) for stack in used]
    times = np.array([stack.exposure_s for stack in used])
    counts = np.array([len(stack) for stack in used])
    means = np.array([float(stack.frame_means.mean()) for stack in used])
    errors, freedom = errors_of_means(used, squares)
    later = times > times.min() + SAME_S
    quiet = min(range(len(used)), key=lambda k: (later[k], -counts[k]))
    bend = Bend(float(means[quiet]), curvature)
    means = bend.straight(means)
    at_zero, per_second = line_weights(times, counts / _pixel_variances(squares))

    black = Quantity(
        "black",
        "black level",
        *_weighted_sum(means, errors, at_zero, freedom),
        "DN",
        SECTION,
    )
    rate = Quantity(
        "µ_I",
        "dark signal",
        *_weighted_sum(means, errors, per_second, freedom),
        "DN/s",
        SECTION,
    )
    offsets, rates = _combine(used, squares, at_zero, bend), None
    if per_second.any():
        rates = _combine(used, squares, per_second, bend)
        if rate.low <= 0:
            value, high = max(rate.value, 0.0), max(rate.high, 0.0)
            rate = replace(rate, value=value, low=0.0, high=high).noted("not told from 0")
    else:
        why = "one exposure time: dark current is part of the black level"
        rate, black = unknown(rate, why), black.noted(why)
    cv, family = _nonuniformity(rates, rate)
    frames = frames_of(*used)
    return Dark(
        black=Fitted(_mark_black(black, used[quiet], notes), frames),
        offsets=offsets,
        rate=Fitted(rate, frames),
        cv=Fitted(cv, frames),
        rates=rates,
        family=family,
        quiet=used[quiet],
        squares=squares[quiet],
        notes=tuple(notes),
    )


def _pixel_variances(squares: Sequence[MeanSquares]) -> Float64Array:
    """Temporal variance of a pixel in each stack [DN²], at least a little."""
    variances = [sum(term.value for term in part.variance()) for part in squares]
    return np.array([max(variance, 1e-9) for variance in variances])


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
    """The stacks with 2 frames or more and no clipped values, and notes on the others.

    Raises InputError where there is none.
    """
    inside: list[Stack] = []
    left_out: list[Stack] = []
    for stack in stacks:
        suits = len(stack) > 1 and stack.clipping.usable
        (inside if suits else left_out).append(stack)
    if not inside:
        reasons = "; ".join(
            f"{stack.source}: {stack.clipping.note or f'{len(stack)} frame'}"
            for stack in stacks[:3]
        )
        raise InputError(
            f"no dark stack has 2 frames or more inside of the ADC's range ({reasons}); take others."
        )
    notes = [
        f"{stack.source} left out: {stack.clipping.note or 'one frame'}" for stack in left_out
    ]
    return inside, notes


def _weighted_sum(
    means: Float64Array, errors: Float64Array, weights: Float64Array, freedom: float
) -> tuple[float, float, float]:
    """(value, low, high) of a sum with weights of independent means."""
    value, error = float(weights @ means), math.sqrt(float(weights**2 @ errors**2))
    if math.isinf(freedom):
        return normal_interval(value, error)
    return student_interval(value, error, freedom)


def _mark_black(black: Quantity, quiet: Stack, notes: Sequence[str]) -> Quantity:
    """The black level with what clipping and rounding do to it.

    The mean of rounded normal values is off by exp(−2π²σ²)/π at most.
    """
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
        """The values that a linear response would have given."""
        if not self.curvature:
            return values
        return self.black + straight(values - self.black, self.curvature)


def _combine(
    stacks: Sequence[Stack], squares: Sequence[MeanSquares], weights: Float64Array, bend: Bend
) -> CombinedMap:
    """Weighted sum of the stacks' means, and the temporal noise that is left in it."""
    image = np.zeros(stacks[0].shape)
    noises: list[Noise] = []
    for stack, stack_squares, weight in zip(stacks, squares, weights, strict=True):
        image += weight * bend.straight(stack.mean)
        if weight:
            noises.append(Noise(stack_squares, float(weight**2) / len(stack)))
    return CombinedMap(image, tuple(noises))


def _nonuniformity(rates: CombinedMap | None, rate: Quantity) -> tuple[Quantity, str | None]:
    """cv and distribution of the rates of the pixels."""
    like = no_value("D_N", "non-uniformity of the dark current", "", SECTION)
    if rates is None or not rate.low > 0:
        return unknown(like, "dark current is not told from 0"), None
    value, low, high = rates.spread()["all"]
    noise = math.sqrt(max(float(rates.image.var()) - value**2, 0.0))
    family, wider = None, 1.0
    if low > 0 and value > CLEAR * noise:
        family = _likeliest_family(rates.image)
    if family is not None:
        wider = math.sqrt(1 + EXCESS[family](value / rate.value) / 2)
    cv = replace(
        like,
        value=value,
        low=max(value + wider * (low - value), 0.0),
        high=max(value + wider * (high - value), 0.0),
    )
    cv = cv.divided(rate, "")
    if not low > 0:
        cv = cv.noted("not told from 0")
    return cv, family


def _likeliest_family(image: Float64Array) -> str | None:
    """The family with the smallest BIC, which is the likeliest: all have two parameters."""
    values = image.ravel()[:: max(1, image.size // MOST_VALUES)]
    positive = values[values > 0]
    if 1 - positive.size / values.size > NEGATIVE:
        return None
    weights = np.ones(positive.size)
    likelihoods: dict[str, float] = {}
    for name, family in FAMILIES.items():
        parameters = family.fit(positive, weights)
        likelihoods[name] = float(family.log_density(positive, parameters).sum())
    return FAMILY_NAMES[max(likelihoods, key=lambda name: likelihoods[name])]
