"""Flicker modulation index, flicker detection index and modulation mitigation probability (IEEE 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers, require
from ....core.plots import name_level
from ....core.types import Float64Array
from ...quantity import TWO_SIDED, Figures, Quantity, no_value, share_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "IEEE 2020"
PIXELS_MIN, FRAMES_MIN = 16, 4
SIGMAS_DOWN, SIGMAS_UP = 2.15, 2.55
"""Widths of the interval [standard errors]. Both halves of the pixels may choose the same frame at random, and the true
end of a wave lies half a standard error outside the frame that noise makes its end, for a sine of many frames."""


@dataclass(frozen=True, eq=False)
class Flicker(Figures):
    """Results of frames of a flickering light.

    means : mean of the region in each frame, shape (N,) [DN].  error : its standard error from temporal noise [DN].
    modulation : flicker modulation index.  detection : flicker detection index.  mitigation : probability.
    """

    means: Float64Array
    error: float
    modulation: Quantity
    detection: Quantity
    mitigation: Quantity

    def plot(self, ax: Axes) -> None:
        """Plot the mean of the region versus frame number."""
        ax.errorbar(
            range(len(self.means)), self.means, yerr=TWO_SIDED * self.error, fmt="o", ms=3
        )
        name_level(ax, "mean", y=self.means.mean())
        ax.set(xlabel="frame", ylabel="mean of the region above black [DN]")


def flicker(
    frames: ArrayLike,
    *,
    off: float | None = None,
    threshold: float = 0.1,
    tolerance: float = 0.1,
) -> Flicker:
    """Measure how much a light flickers, how often it is detected, and how often it has its mean brightness.

    ::

        level = 100 + 80 * np.sin(np.arange(50))
        frames = level[:, None, None] + np.random.default_rng(1).normal(0, 5, (50, 16, 16))
        print(ms.lab.flicker(frames).modulation)

    frames : linear values of the light's pixels without the black level, shape (N, H, W), at random phases.
    off : level of the region with the light off, for the detection index [DN above black].
    threshold : contrast bright / off − 1 from which on the light is detected.
    tolerance : relative deviation from the mean within which a frame counts as mitigated.
    Raises InputError for fewer than 4 frames or 16 pixels, and for regions that are not brighter than black.
    """
    wanted = f"at least {FRAMES_MIN} frames of {PIXELS_MIN} pixels (frames, rows, columns)"
    pixels = finite_numbers("frames", frames, wanted)
    if pixels.ndim != 3 or len(pixels) < FRAMES_MIN or pixels[0].size < PIXELS_MIN:
        raise InputError(f"frames has shape {pixels.shape}; pass {wanted}.")
    threshold = require("threshold", threshold, 0.0, 1e6, "a contrast, e.g. 0.1")
    tolerance = require("tolerance", tolerance, 0.0, 1.0, "relative to the mean, e.g. 0.1")
    rows = pixels.reshape(len(pixels), -1)
    means = rows.mean(axis=1)
    if not means.mean() > 0:
        raise InputError(
            f"frames has a mean of {means.mean():.3g}, not brighter than black; subtract only the black level."
        )
    errors = _errors(rows, means)
    if not means.mean() > TWO_SIDED * np.sqrt(np.square(errors).mean() / len(means)):
        raise InputError(
            "frames are as dark as their noise; pass only the pixels of the light."
        )
    detection = no_value("FDI", "flicker detection index", "", SECTION)
    if off is None:
        detection = detection.noted("needs off")
    else:
        off = require("off", off, 1e-12, 1e12, "the level without the light, above black")
        seen = float((means / off - 1 > threshold).mean())
        detection = detection.with_interval(share_interval(seen, len(means)))
    steady = float((np.abs(means / means.mean() - 1) < tolerance).mean())
    mitigation = no_value("MMP", "modulation mitigation probability", "", SECTION)
    mitigation = mitigation.with_interval(share_interval(steady, len(means)))
    error = float(np.sqrt(np.square(errors).mean()))
    return Flicker(means, error, _modulation(rows, errors), detection, mitigation)


def _errors(rows: Float64Array, means: Float64Array) -> Float64Array:
    """Return the standard error of each frame's mean, from the deviations of its pixels from a scaled mean frame."""
    pattern = rows.mean(axis=0) - rows.mean()
    centred = rows - means[:, None]
    power = max(float(pattern @ pattern), 1e-300)
    rest = centred - (centred @ pattern / power)[:, None] * pattern
    count, frames = rows.shape[1], len(rows)
    variance = np.square(rest).sum(axis=1) / (count - 2) * frames / (frames - 1)
    return np.asarray(np.sqrt(variance / count))


def _modulation(rows: Float64Array, errors: Float64Array) -> Quantity:
    """Return (largest − smallest) / (largest + smallest) of the levels of the frames.

    Every second pixel selects the extreme frames, and the others give their levels, so noise does not add.
    """
    halves = [part.mean(axis=1) for part in (rows[:, ::2], rows[:, 1::2])]
    top = [int(np.argmax(half)) for half in halves]
    bottom = [int(np.argmin(half)) for half in halves]
    bright = (halves[1][top[0]] + halves[0][top[1]]) / 2
    dark = (halves[1][bottom[0]] + halves[0][bottom[1]]) / 2
    size = (bright - dark) / (bright + dark)
    slopes = 2 * np.abs([dark, bright]) / (bright + dark) ** 2
    steps = np.array([errors[top].mean(), errors[bottom].mean()])
    error = float(np.hypot(*(slopes * steps)))
    value = min(max(float(size), 0.0), 1.0)
    low, high = float(size) - SIGMAS_DOWN * error, float(size) + SIGMAS_UP * error
    ends = max(min(low, value), 0.0), min(max(high, value), 1.0)
    return Quantity("FMI", "flicker modulation index", value, *ends, "", SECTION)
