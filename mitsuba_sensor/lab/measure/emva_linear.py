"""Temporal figures of EMVA 1288 R4 Linear from dark frames and flat fields, and the SNR."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...core.plots import set_log_axes
from ...core.types import Float64Array
from ..frames.selection import temporal_levels
from ..frames.series import Report, Series, series
from ..frames.stack import Stack
from ..frames.temporal import neighbour_correlation
from ..quantity import Quantity
from .curved_response import Curve, curvature, small_signals
from .dark_noise import DarkNoise, dark_noise
from .photon_transfer import PhotonTransfer, photon_transfer
from .radiometric import EFFICIENCY, TOO_EFFICIENT, Radiometric, radiometric
from .saturation import NO_PHOTONS, Saturation, find_peak, saturation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


CORRELATION_MAX = 0.2
"""Largest correlation of neighbours' temporal noise in raw frames; coupled pixels have less than 0.1."""


@dataclass(frozen=True, eq=False)
class EmvaLinear:
    """Results of EMVA 1288 Linear.

    quantities : all figures, K first, then η and the figures of the parts.  notes : remarks on the frames.
    levels : levels of flat fields and dark frames.  curve : of the response; K, R and η are for small signals along it,
    with intervals that include a line and a curve if the levels do not distinguish them.
    photon_transfer : along the curve.  as_measured : by EMVA 1288 Linear, without a curve.
    """

    quantities: tuple[Quantity, ...]
    photon_transfer: PhotonTransfer
    radiometric: Radiometric
    dark_noise: DarkNoise
    saturation: Saturation
    snr: SignalToNoise
    notes: tuple[str, ...]
    levels: Series
    curve: Curve
    as_measured: PhotonTransfer

    @property
    def plots(self) -> dict[str, Callable[[Axes], object]]:
        """Plot functions by title."""
        return {
            "Radiometric function": self.radiometric.plot,
            "Photon transfer, linear": self.as_measured.plot,
            "Photon transfer, logarithmic": partial(self.as_measured.plot, log=True),
            "Signal-to-noise ratio, linear": partial(self.snr.plot, log=False),
            "Signal-to-noise ratio, logarithmic": self.snr.plot,
            "Linearity": self.radiometric.plot_deviation,
        }

    def __getitem__(self, symbol: str) -> Quantity:
        """Return a figure by its symbol: ``K``, ``η``, ``R``, ``LE``, ``σ_y.dark``, ``σ_d``, ``µ_e.sat``, ``DR``, …"""
        return {figure.symbol: figure for figure in self.quantities}[symbol]


def emva_linear(
    darks: Sequence[Stack], flats: Sequence[Stack], report: Report | None = None
) -> EmvaLinear:
    """Measure a camera in stacks of at least two frames.

    darks : one stack for each exposure time, or one for all.  flats : levels from nearly dark to above saturation, with
    photons per pixel; without photons, η and figures that need it stay unknown.  report : called after each stack with
    the number of measured and of all stacks.

    A figure that cannot be measured is NaN with a note. Raises InputError if stacks do not belong together or have a
    single frame, a mosaic, or no flat fields.
    """
    used = temporal_levels(flats)
    measured = series(darks, used, report)
    end = find_peak(measured)
    curve = curvature(measured, end)
    straightened, transfer = small_signals(measured, curve)
    if smoothed := _note_smoothed(used):
        transfer = replace(transfer, gain=transfer.gain.without_value(smoothed))
    gain, light = transfer.gain, _light_along(measured, curve, straightened)
    efficiency = light.efficiency(gain)
    dark = dark_noise(darks, gain, measured.darks)
    usable = efficiency
    if efficiency is not None and TOO_EFFICIENT in efficiency.note:
        usable = None  # the photons are not per pixel
    ends = saturation(straightened, gain, usable, dark.total)
    notes = [*measured.notes, *_note_spatial_stacks(flats, used, measured)]
    as_measured, rows = transfer, [gain]
    if curve:
        ends = replace(ends, signal=saturation(measured, gain, usable, dark.total).signal)
        as_measured = photon_transfer(measured)
        name = f"{as_measured.gain.name} by a straight line"
        rows.append(replace(as_measured.gain, symbol="K_line", name=name))
        change = float(curve.slope(curve.straight(np.array(end.mean[0])))) - 1
        notes.append(f"the response is curved: the slope changes by {100 * change:+.2g} %")
    rows.append(efficiency or EFFICIENCY.without_value(NO_PHOTONS))
    figures = [*rows, *light.quantities, *dark.quantities, *ends.quantities]
    if measured.notes:
        figures = [figure.noted("see the notes of the series") for figure in figures]
    snr = signal_to_noise(straightened, gain, usable, dark.total)
    parts = transfer, light, dark, ends, snr
    return EmvaLinear(tuple(figures), *parts, tuple(notes), measured, curve, as_measured)


def _note_smoothed(flats: Sequence[Stack]) -> str:
    """Return why denoised, resized or interpolated frames show no K, or an empty text."""
    inside = [flat for flat in flats if flat.clipping.usable and flat.shape[1] > 8]
    inside.sort(key=lambda stack: float(stack.frame_means[0]))
    correlation = neighbour_correlation(inside[len(inside) // 2]) if inside else 0.0
    if correlation < CORRELATION_MAX:
        return ""
    return (
        f"the temporal noise of neighbouring pixels is correlated by {correlation:.2f}, as in denoised, resized or "
        "demosaiced frames, so its variance is too small; take raw frames"
    )


def _light_along(measured: Series, curve: Curve, straightened: Series) -> Radiometric:
    """Return the response to light with R for small signals, or for a line and a curve if both are possible."""
    light = radiometric(measured)
    responsivity = light.responsivity
    if curve:
        responsivity = radiometric(straightened).responsivity.noted(curve.note)
    if curve.possible:
        other = radiometric(curve.possible.straighten(measured)).responsivity
        responsivity = responsivity.noted(curve.note).extended(other)
    return replace(light, responsivity=responsivity)


def _note_spatial_stacks(
    flats: Sequence[Stack], used: Sequence[Stack], measured: Series
) -> list[str]:
    """Return a note on the stacks of many frames that temporal figures do not use, with their deviations."""
    texts: list[str] = []
    for flat in flats:
        if any(flat is other for other in used):
            continue
        text = f"{len(flat)} frames"
        if isinstance(flat.photons, int | float) and measured.photons_known:
            signal = float(flat.frame_means.mean() - measured.darks[0].mean)
            expected = float(np.interp(flat.photons, measured.light, measured.signal))
            if expected:
                percent = round(100 * (signal / expected - 1), 2)
                text += f", signal {percent:+.2g} % off the line of the other stacks"
        texts.append(f"{flat.source} ({text})")
    omitted = "K, η and temporal noise are measured without the stacks of many frames, which serve the spatial figures"
    return [f"{omitted}: {', '.join(texts)}"] if texts else []


@dataclass(frozen=True, eq=False)
class SignalToNoise:
    """Signal-to-noise ratio of a series.

    light : photons per pixel or, if unknown, photoelectrons.  measured : (µ_y − µ_y.dark) / σ_y, NaN for levels without
    signal, clipped levels and levels above saturation.  model : ηµ_p / √(σ_y.dark²/K² + ηµ_p) (EMVA 1288 R4 2.3).
    ideal : √µ_p, or √µ_e.
    """

    light: Float64Array
    measured: Float64Array
    model: Float64Array
    ideal: Float64Array
    photons_known: bool

    def plot(self, axes: Axes, log: bool = True) -> None:
        """Plot measured, model and ideal SNR.  log : True for logarithmic axes, as in EMVA 1288."""
        shown = np.isfinite(self.measured)
        axes.plot(self.light[shown], self.measured[shown], "o", ms=3, label="measured")
        axes.plot(self.light, self.model, lw=1, label="model")
        axes.plot(self.light, self.ideal, "--", color="black", lw=1, label="ideal sensor")
        quanta = "photons" if self.photons_known else "photoelectrons"
        axes.set(xlabel=f"{quanta} per pixel", ylabel="SNR")
        if log:
            set_log_axes(axes)


def signal_to_noise(
    measured: Series, gain: Quantity, efficiency: Quantity | None, dark: Quantity
) -> SignalToNoise:
    """Return the SNR of a series from K [DN/e-], QE or None, and σ_y.dark [DN]."""
    noise = np.sqrt(measured.of_flats("variance"))
    below_saturation = measured.signal <= find_peak(measured).mean[0]
    usable = measured.inside & (measured.signal > 0) & below_saturation & (noise > 0)
    if efficiency is None:
        light = electrons = measured.signal / gain.value
    else:
        light = measured.light
        electrons = efficiency.value * light
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(usable, measured.signal / noise, np.nan)
        model = electrons / np.sqrt((dark.value / gain.value) ** 2 + electrons)
        ideal = np.sqrt(light)
    return SignalToNoise(light, ratio, model, ideal, efficiency is not None)
