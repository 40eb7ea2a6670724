"""Spectrograms of rows and columns, and the whiteness of their noise (EMVA 1288 A2.01 7.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Quantity, no_value, normal_interval
from ..statistics.outliers import fill, note_left_out_pixels, outliers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 A2.01 7.3.2"
LINES_AT_ONCE = 64
"""Number of lines that are transformed at once, which limits memory."""


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """Rms over lines of the Fourier amplitude, normalised so its mean square is the variance of the image.

    direction : "horizontal" (along the rows) or "vertical" (along the columns).
    frequency : 0 to 0.5, (N + 1,) [cycles per pixel], N the length of a line.
    amplitude : S at these frequencies, (N + 1,) [DN].
    non_whiteness : F = mean S² / (median S)², 1 for white noise, 1.4427 for equal lines.
    """

    direction: str
    frequency: Float64Array
    amplitude: Float64Array
    non_whiteness: Quantity

    def plot(self, ax: Axes) -> None:
        """Plot S versus frequency, and the median of S, which is its white part."""
        ax.plot(self.frequency, self.amplitude, lw=0.8, label=self.direction)
        ax.axhline(float(np.median(self.amplitude)), color="0.4", ls="--", lw=1, label="median")
        ax.set(xlabel="spatial frequency [cycles/pixel]", ylabel="amplitude S [DN]")
        if (self.amplitude > 0).all():
            ax.set_yscale("log")


def spectrograms(image: Stack | Float64Array) -> tuple[Spectrogram, Spectrogram]:
    """Return the horizontal and vertical spectrogram of an image (H, W) [DN], or of the mean of a stack.

    The mean is subtracted, and each line is padded with as many zeros. Outlying pixels of a stack, whose spectrum is
    white, are filled from their lines, and a note counts them.
    Raises InputError for a mosaic.
    """
    if not isinstance(image, Stack):
        return _spectrogram("horizontal", image), _spectrogram("vertical", image.T)
    image.require_one_filter()
    left_out = outliers(image.mean)
    note = note_left_out_pixels(left_out)
    marked = (
        replace(one, non_whiteness=mark_clipped(one.non_whiteness.noted(note), image))
        for one in spectrograms(fill(image.mean, left_out))
    )
    return next(marked), next(marked)


def _spectrogram(direction: str, image: Float64Array) -> Spectrogram:
    """Return the spectrogram along the rows of an image."""
    lines, length = image.shape
    mean, power = float(image.mean()), np.zeros(length + 1)
    for top in range(0, lines, LINES_AT_ONCE):
        deviations = np.asarray(image[top : top + LINES_AT_ONCE], np.float64) - mean
        spectrum = scipy.fft.rfft(deviations, 2 * length, axis=1)
        power += np.square(np.abs(spectrum)).sum(axis=0)
    power /= lines * length
    frequency = np.linspace(0, 0.5, length + 1)
    figure = _non_whiteness(direction, power, lines)
    return Spectrogram(direction, frequency, np.sqrt(power), figure)


def _non_whiteness(direction: str, power: Float64Array, lines: int) -> Quantity:
    """Return F, with the error of a mean over a median from the scatter over frequencies.

    The factor 1.15 over the length of a line was measured for white noise of 1 to 512 lines, where padding correlates
    neighbouring frequencies. A spectrum that is smooth but not flat gets too wide an interval.
    """
    name, length = f"non-whiteness, {direction}", len(power) - 1
    if length < 8:
        few = f"lines have {length} pixels; at least 8 are needed"
        return no_value("F", name, "", SECTION, few)
    median = float(np.median(power))
    if not median:
        return no_value("F", name, "", SECTION, "the image is constant")
    mean = float(power.mean())
    below, above = np.quantile(power, (0.4, 0.6))
    density = 0.2 / max(above - below, 1e-12 * median)
    adds = power / mean - np.sign(power - median) / (2 * density * median)
    error = mean / median * float(adds.std()) * math.sqrt(1.15 / length)
    white = lines / float(scipy.special.gammaincinv(lines, 0.5))
    note = ""
    if white > 1.005:
        note = f"white noise of {lines} lines has {white:.3f}"
    return Quantity("F", name, *normal_interval(mean / median, error), "", SECTION, note)
