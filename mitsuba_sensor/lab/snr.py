"""Signal-to-noise ratio against light: measured, of the linear model, and of an ideal sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.types import Float64Array
from .quantity import Quantity
from .saturation import find_peak
from .series import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class SignalToNoise:
    """light : photons per pixel, or photoelectrons where photons are not known.  measured : (µ_y - µ_y.dark) / σ_y.

    model : ηµ_p / sqrt(σ_y.dark²/K² + ηµ_p), EMVA 1288 R4 2.3.  ideal : sqrt(µ_p), or sqrt(µ_e).
    Levels without signal, with clipped values, and above saturation, where noise is cut, have NaN.
    """

    light: Float64Array
    measured: Float64Array
    model: Float64Array
    ideal: Float64Array
    photons_known: bool

    def plot(self, axes: Axes, log: bool = True) -> None:
        """The three of them; log for both axes logarithmic, as EMVA 1288 draws it."""
        shown = np.isfinite(self.measured)
        axes.plot(self.light[shown], self.measured[shown], "o", markersize=3, label="measured")
        axes.plot(self.light, self.model, linewidth=1, label="model")
        axes.plot(self.light, self.ideal, "--", color="black", linewidth=1, label="ideal sensor")
        axes.set(xlabel="photons per pixel" if self.photons_known else "photoelectrons per pixel", ylabel="SNR")
        if log:
            axes.set(xscale="log", yscale="log")


def signal_to_noise(measured: Series, gain: Quantity, efficiency: Quantity | None, dark: Quantity) -> SignalToNoise:
    """From a series, K [DN/e-], QE [1] or None, and σ_y.dark [DN]."""
    noise = np.sqrt(measured.of_flats("variance"))
    below = measured.inside & (measured.signal > 0) & (measured.signal <= find_peak(measured).mean[0]) & (noise > 0)
    light = measured.signal / gain.value if efficiency is None else measured.light
    electrons = light if efficiency is None else efficiency.value * light
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(below, measured.signal / noise, np.nan)
        model = electrons / np.sqrt((dark.value / gain.value) ** 2 + electrons)
        ideal = np.sqrt(light)
    return SignalToNoise(light, ratio, model, ideal, efficiency is not None)
