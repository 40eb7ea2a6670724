"""MTF versus spatial frequency with its 95 % band, its figures MTF50 and MTF at the Nyquist frequency; and checks of
the images for its measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers
from ....core.plots import name_level
from ....core.types import Float64Array
from ...quantity import TWO_SIDED, Quantity, no_value
from ...statistics.estimators import noncentrality_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NYQUIST = 0.5
"""Nyquist frequency of the pixels [cycles per pixel]."""
NORMAL_SIGMAS_MIN = 6.0
"""Modulus of a complex value over its standard error from which on its distribution is normal."""


@dataclass(frozen=True, eq=False)
class Modulation:
    """MTF versus frequency.

    frequency : ascending from 0 [cycles per pixel].  value : MTF, 1 at frequency 0.
    low, high : ends of the 95 % interval at each frequency.  section : place of the definition.
    note : what restricts the figures, or empty.
    """

    frequency: Float64Array
    value: Float64Array
    low: Float64Array
    high: Float64Array
    section: str
    note: str = ""

    @property
    def mtf50(self) -> Quantity:
        """Frequency at which the MTF falls to one half."""
        return self.falls_to(0.5)

    @property
    def at_nyquist(self) -> Quantity:
        """MTF at half a cycle per pixel."""
        return self.at(NYQUIST)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """MTF50 and MTF at the Nyquist frequency."""
        return self.mtf50.noted(self.note), self.at_nyquist.noted(self.note)

    def at(self, frequency: float) -> Quantity:
        """Return the MTF at a frequency [cycles per pixel]; no value outside of the curve."""
        symbol, name = f"MTF({frequency:g})", f"modulation at {frequency:g} cycles per pixel"
        if not self.frequency[0] <= frequency <= self.frequency[-1]:
            note = f"the curve is from {self.frequency[0]:.3g} to {self.frequency[-1]:.3g}"
            return no_value(symbol, name, "", self.section, note)
        curves = self.value, self.low, self.high
        value, low, high = (float(np.interp(frequency, self.frequency, c)) for c in curves)
        return Quantity(symbol, name, value, low, high, "", self.section)

    def falls_to(self, share: float) -> Quantity:
        """Return the first frequency [cycles per pixel] at which the MTF has this value, with the interval of the band.

        There is no value if the curve stays above.
        """
        symbol = f"MTF{100 * share:.0f}"
        name = f"frequency of {100 * share:.0f} % modulation"
        crossings = _crossings(self.frequency, self.value, share)
        if not crossings.size:
            note = f"more than {share:g} up to {self.frequency[-1]:.3g} cycles per pixel"
            return no_value(symbol, name, "cy/px", self.section, note)
        place = float(crossings[0])
        lower, upper = (_crossings(self.frequency, end, share) for end in (self.low, self.high))
        low = float(np.max(lower[lower <= place], initial=self.frequency[0]))
        high = float(np.min(upper[upper >= place], initial=self.frequency[-1]))
        return Quantity(symbol, name, place, low, high, "cy/px", self.section)

    def plot(self, ax: Axes, label: str = "measured") -> None:
        """Plot the curve with its band."""
        ax.plot(self.frequency, self.value, label=label)
        ax.fill_between(self.frequency, self.low, self.high, alpha=0.25)
        name_level(ax, "Nyquist frequency", x=NYQUIST)
        ax.set(xlabel="spatial frequency [cycles per pixel]", ylabel="modulation")
        ax.set_ylim(0, None)


@dataclass(frozen=True, eq=False)
class OfModulation:
    """A result whose figures are read from an MTF."""

    modulation: Modulation

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """MTF50 and MTF at the Nyquist frequency."""
        return self.modulation.quantities

    def plot(self, ax: Axes) -> None:
        """Plot the MTF with its band."""
        self.modulation.plot(ax)


def _crossings(frequency: Float64Array, curve: Float64Array, share: float) -> Float64Array:
    """Return the frequencies at which a curve falls through a value."""
    above = curve >= share
    before = np.flatnonzero(above[:-1] & ~above[1:])
    fall = curve[before] - curve[before + 1]
    steps = np.diff(frequency)[before]
    return np.asarray(frequency[before] + steps * (curve[before] - share) / fall)


def modulus(
    transform: Float64Array, radial_variance: Float64Array, tangential_variance: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return (value, low, high) of the modulus of complex values with normal noise.

    radial_variance, tangential_variance : of the noise along and across the values.

    The average contribution of tangential noise to the modulus is subtracted. Near 0 the interval follows the Rice
    distribution and ends at 0.
    """
    size, error = np.abs(transform), np.sqrt(radial_variance)
    value = np.sqrt(np.maximum(np.square(size) - tangential_variance, 0.0))
    low, high = value - TWO_SIDED * error, value + TWO_SIDED * error
    small = (value < NORMAL_SIGMAS_MIN * error) & (error > 0)
    square = np.square(size[small] / error[small])
    lowest, highest = noncentrality_interval(square, 2)
    low[small] = np.minimum(error[small] * np.sqrt(lowest), value[small])
    high[small] = np.maximum(error[small] * np.sqrt(highest), value[small])
    return value, low, high


def picture_of(picture: ArrayLike, name: str = "picture") -> Float64Array:
    """Return an image (H, W) as float64.  name : of the argument.

    Raises InputError for another shape and for values that are not finite.
    """
    wanted = "values (rows, columns), e.g. stack.mean − the black level"
    pixels = finite_numbers(name, picture, wanted)
    if pixels.ndim != 2 or min(pixels.shape) < 2:
        raise InputError(f"{name} has shape {pixels.shape}; pass {wanted}.")
    return pixels


def flat_fielded(picture: Float64Array, flat: ArrayLike | None) -> Float64Array:
    """Return the image over a flat field of mean 1. Raises InputError for another shape and values of 0 or less."""
    if flat is None:
        return picture
    light = picture_of(flat, "flat")
    if light.shape != picture.shape or not light.min() > 0:
        raise InputError(
            f"flat has shape {light.shape} and values from {light.min():g}; pass positive values of shape "
            f"{picture.shape}."
        )
    return np.asarray(picture * (light.mean() / light))
