"""Flicker modulation index, flicker detection index and modulation mitigation probability (IEEE 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers, require
from ....core.types import Float64Array
from ...quantity import TWO_SIDED, Figures, Quantity, no_value, share_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "IEEE 2020"
FEWEST_PIXELS, FEWEST_FRAMES = 16, 4
INWARD, OUTWARD = 2.15, 2.55
"""Ends of the interval [standard errors].

Both halves of the pixels may choose one frame by chance; and the true end of a wave lies beyond the frame that noise
lets appear as its end, by half a standard error for a sine of many frames."""


@dataclass(frozen=True, eq=False)
class Flicker(Figures):
    """What frames of a flickering light show.

    means : (N,) of the region in every frame [DN].  error : standard error of each from temporal noise [DN].
    modulation : flicker modulation index.  detection : flicker detection index.  mitigation : probability.
    """

    means: Float64Array
    error: float
    modulation: Quantity
    detection: Quantity
    mitigation: Quantity

    def plot(self, ax: Axes) -> None:
        """The region's mean over the frames."""
        ax.errorbar(
            range(len(self.means)), self.means, yerr=TWO_SIDED * self.error, fmt="o", ms=3
        )
        ax.axhline(self.means.mean(), color="0.6", lw=1)
        ax.set(xlabel="frame", ylabel="mean of the region above black [DN]")


def flicker(
    frames: ArrayLike,
    *,
    off: float | None = None,
    threshold: float = 0.1,
    tolerance: float = 0.1,
) -> Flicker:
    """How much a light flickers in frames of it, how often it is seen, and how often as bright as on average.

    ::

        level = 100 + 80 * np.sin(np.arange(50))
        frames = level[:, None, None] + np.random.default_rng(1).normal(0, 5, (50, 16, 16))
        print(ms.lab.flicker(frames).modulation)

    frames : (N, H, W) linear values without the black level, the pixels of the light alone, at phases by chance.
    off : level of the same region when the light is off, for the detection index [DN above black].
    threshold : contrast against off, bright / off − 1, from which on the light is detected.
    tolerance : share of the mean within which a frame counts as mitigated.
    Raises InputError for fewer than 4 frames or 16 pixels, and for regions that are not brighter than black.
    """
    wanted = f"{FEWEST_FRAMES} frames or more of {FEWEST_PIXELS} pixels or more (frames, rows, columns)"
    pixels = finite_numbers("frames", frames, wanted)
    if pixels.ndim != 3 or len(pixels) < FEWEST_FRAMES or pixels[0].size < FEWEST_PIXELS:
        raise InputError(f"frames has shape {pixels.shape}; pass {wanted}.")
    threshold = require("threshold", threshold, 0.0, 1e6, "a contrast, e.g. 0.1")
    tolerance = require("tolerance", tolerance, 0.0, 1.0, "a share of the mean, e.g. 0.1")
    rows = pixels.reshape(len(pixels), -1)
    means = rows.mean(axis=1)
    if not means.mean() > 0:
        raise InputError(
            "the region is not brighter than black; take off the black level only."
        )
    errors = _errors(rows, means)
    if not means.mean() > TWO_SIDED * np.sqrt(np.square(errors).mean() / len(means)):
        raise InputError(
            "the region is as dark as its noise; pass the pixels of the light alone."
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
    """Standard error of the mean of every frame, from what its pixels differ from a line of the mean pixels."""
    pattern = rows.mean(axis=0) - rows.mean()
    centred = rows - means[:, None]
    power = max(float(pattern @ pattern), 1e-300)
    rest = centred - (centred @ pattern / power)[:, None] * pattern
    count, frames = rows.shape[1], len(rows)
    variance = np.square(rest).sum(axis=1) / (count - 2) * frames / (frames - 1)
    return np.asarray(np.sqrt(variance / count))


def _modulation(rows: Float64Array, errors: Float64Array) -> Quantity:
    """(largest − smallest) / (largest + smallest) of the levels of the frames.

    Every second pixel says which frame has the end, and the others how bright it is: noise does not add to it.
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
    low, high = float(size) - INWARD * error, float(size) + OUTWARD * error
    ends = max(min(low, value), 0.0), min(max(high, value), 1.0)
    return Quantity("FMI", "flicker modulation index", value, *ends, "", SECTION)
