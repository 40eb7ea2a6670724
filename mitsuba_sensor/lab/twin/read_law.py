"""Tails of the read noise: Tukey's lambda from the L-kurtosis over the frames of each pixel.

L-moments (Hosking, J. R. Stat. Soc. B 52, 105, 1990) are linear in σ: their sums over pixels of different σ have the
ratios of one pixel. τ₄ is 0.1226 for a normal law and (λ − 1)(λ − 2)/((λ + 3)(λ + 4)) for Tukey's.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.types import Float64Array
from ..frames.stack import ROUNDING_DN2, Stack
from ..quantity import Quantity, no_value, student_interval, unknown

NO_SHAPE = no_value("λ", "shape of the read noise's law", "", "L-kurtosis, Hosking 1990")
NORMAL_TAU4 = 30 / math.pi * math.atan(math.sqrt(2)) - 9
"""τ₄ of a normal law: 0.1226."""
FEWEST_FRAMES = 6
LEAST_DN2 = 0.6
"""Temporal variance below which rounding changes τ₄ where the means of all pixels are equal."""
MOST_VALUES = 2**22
"""Rows are left out, evenly, until there are no more: σ of τ₄ is 2e-4 by then."""
BLOCKS = 32
"""Groups of rows from whose differences the standard error comes."""
ALARM = 3.5
"""Standard errors of τ₄ from that of a normal law up to which the noise is normal: 1 false alarm in 700."""
HEAVIEST, LIGHTEST = -0.45, 0.2
"""Ends of λ in a camera file."""


def read_law(stack: Stack) -> Quantity:
    """λ of the read noise in dark frames; without a value, and with the reason, where the noise is normal."""
    if len(stack) < FEWEST_FRAMES:
        few = f"{len(stack)} frames; the tails of the noise need {FEWEST_FRAMES}"
        return unknown(NO_SHAPE, f"assumed normal: {few}")
    if stack.whole_codes and stack.changes.variance < LEAST_DN2:
        return unknown(NO_SHAPE, "assumed normal: hidden by rounding")
    tau4, error, blocks = _tau4(stack)
    variance = stack.changes.variance
    other = ROUNDING_DN2 / variance if stack.whole_codes else 0.0
    other += sum(1 / length for length in stack.shape)
    # Rounding and what line means bring of other pixels are normal: fourth cumulants decrease as the square.
    diluted = (1 - min(other, 0.5)) ** 2
    tau4, error = NORMAL_TAU4 + (tau4 - NORMAL_TAU4) / diluted, error / diluted
    _, low, high = student_interval(tau4, error, blocks - 1)
    text = f"τ₄ is {tau4:.4f} ({low:.4f} to {high:.4f}), {NORMAL_TAU4:.4f} for a normal law"
    if not abs(tau4 - NORMAL_TAU4) > ALARM * error:
        return unknown(NO_SHAPE, text)
    value, most, least = (tukey_shape(ratio) for ratio in (tau4, low, high))
    return Quantity("λ", NO_SHAPE.name, value, least, most, "", NO_SHAPE.section, text)


def tukey_shape(tau4: float) -> float:
    """λ of Tukey's law of this τ₄, within the range of a camera file."""
    a, b, c = 1 - tau4, 3 + 7 * tau4, 2 - 12 * tau4
    shape = (b - math.sqrt(max(b**2 - 4 * a * c, 0.0))) / (2 * a)
    return min(max(shape, HEAVIEST), LIGHTEST)


def _tau4(stack: Stack) -> tuple[float, float, int]:
    """τ₄ of the pixels without what rows, columns and frames share, its standard error, and the number of blocks."""
    height, width = stack.shape
    distance = max(1, math.ceil(len(stack) * height * width / MOST_VALUES))
    rows = np.arange(0, height, distance)
    by_block = []
    for block in np.array_split(rows, min(BLOCKS, rows.size)):
        values = stack.frames[:, block].astype(np.float64)
        values += stack.frame_means[:, None, None]
        values -= stack.row_means[:, block, None]
        values -= stack.column_means[:, None, :]
        by_block.append(sample_l_moments(values).sum(axis=(1, 2)))
    second, fourth = np.array(by_block).T
    tau4 = float(fourth.sum() / second.sum())
    rest = fourth - tau4 * second
    count = len(rest)
    error = math.sqrt(rest @ rest * count / max(count - 1, 1)) / float(second.sum())
    return tau4, error, count


def sample_l_moments(values: Float64Array) -> Float64Array:
    """Unbiased l₂ and l₄ along the first axis, (2, …)."""
    ordered, n = np.sort(values, axis=0), len(values)
    rank, weight = np.arange(n, dtype=np.float64), np.ones(n)
    b = []
    for k in range(4):
        b.append(np.tensordot(weight, ordered, 1) / n)
        weight = weight * np.maximum(rank - k, 0.0) / (n - 1 - k)
    return np.array([2 * b[1] - b[0], 20 * b[3] - 30 * b[2] + 12 * b[1] - b[0]])
