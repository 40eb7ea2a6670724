"""Tails of the read noise: Tukey's λ from the temporal L-kurtosis of each pixel.

L-moments (Hosking, J. R. Stat. Soc. B 52, 105, 1990) are linear in σ, so their sums over pixels with different σ have
the ratios of a single pixel. τ₄ is 0.1226 for a normal distribution and (λ − 1)(λ − 2)/((λ + 3)(λ + 4)) for Tukey's.
"""

from __future__ import annotations

import math

import numpy as np

from ...core.types import Float64Array
from ..frames.stack import ROUNDING_DN2, Stack
from ..quantity import Quantity, no_value, student_interval

NO_SHAPE = no_value("λ", "shape of the read noise's law", "", "L-kurtosis, Hosking 1990")
NORMAL_TAU4 = 30 / math.pi * math.atan(math.sqrt(2)) - 9
"""τ₄ of a normal distribution: 0.1226."""
FRAMES_MIN = 6
VARIANCE_MIN_DN2 = 0.6
"""Temporal variance below which rounding changes τ₄ if all pixels have the same mean."""
VALUES_MAX = 2**22
"""Largest number of values; rows are skipped evenly. The standard error of τ₄ is then 2e-4."""
BLOCKS = 32
"""Number of groups of rows whose differences give the standard error."""
ALARM_SIGMAS = 3.5
"""Distance of τ₄ from a normal distribution up to which noise is normal [standard errors]: 1 false alarm in 700."""
SHAPE_MIN, SHAPE_MAX = -0.45, 0.2
"""Range of λ in a camera file."""


def read_law(stack: Stack) -> Quantity:
    """Return λ of the read noise in dark frames, or no value and the reason if the noise is normal."""
    if len(stack) < FRAMES_MIN:
        few = f"{len(stack)} frames; the tails of the noise need {FRAMES_MIN}"
        return NO_SHAPE.noted(f"assumed normal: {few}")
    if stack.whole_codes and stack.changes.variance < VARIANCE_MIN_DN2:
        return NO_SHAPE.noted("assumed normal: hidden by rounding")
    tau4, error, blocks = _tau4(stack)
    variance = stack.changes.variance
    other = ROUNDING_DN2 / variance if stack.whole_codes else 0.0
    other += sum(1 / length for length in stack.shape)
    # Rounding and the noise of other pixels in line means are normal: fourth cumulants fall as the square.
    diluted = (1 - min(other, 0.5)) ** 2
    tau4, error = NORMAL_TAU4 + (tau4 - NORMAL_TAU4) / diluted, error / diluted
    _, low, high = student_interval(tau4, error, blocks - 1)
    text = f"τ₄ is {tau4:.4f} ({low:.4f} to {high:.4f}), {NORMAL_TAU4:.4f} for a normal distribution"
    if not abs(tau4 - NORMAL_TAU4) > ALARM_SIGMAS * error:
        return NO_SHAPE.noted(text)
    value, most, least = (tukey_shape(ratio) for ratio in (tau4, low, high))
    return Quantity("λ", NO_SHAPE.name, value, least, most, "", NO_SHAPE.section, text)


def tukey_shape(tau4: float) -> float:
    """Return λ of Tukey's distribution with this τ₄, within the range of a camera file."""
    a, b, c = 1 - tau4, 3 + 7 * tau4, 2 - 12 * tau4
    shape = (b - math.sqrt(max(b**2 - 4 * a * c, 0.0))) / (2 * a)
    return min(max(shape, SHAPE_MIN), SHAPE_MAX)


def _tau4(stack: Stack) -> tuple[float, float, int]:
    """Return τ₄ of the pixels without row, column and frame noise, its standard error, and the number of blocks."""
    height, width = stack.shape
    distance = max(1, math.ceil(len(stack) * height * width / VALUES_MAX))
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
    """Return unbiased l₂ and l₄ along the first axis, shape (2, …)."""
    ordered, n = np.sort(values, axis=0), len(values)
    rank, weight = np.arange(n, dtype=np.float64), np.ones(n)
    b = []
    for k in range(4):
        b.append(np.tensordot(weight, ordered, 1) / n)
        weight = weight * np.maximum(rank - k, 0.0) / (n - 1 - k)
    return np.array([2 * b[1] - b[0], 20 * b[3] - 30 * b[2] + 12 * b[1] - b[0]])
