"""Spatial non-uniformity in the dark and in light (DSNU1288, PRNU1288), with its row, column and pixel parts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import Pattern, mark_clipped_sigma, mark_rounding, with_hidden
from ..frames.stack import ONE_FRAME, Stack
from ..frames.temporal import flicker_dn, flicker_note
from ..quantity import Figures, Quantity
from ..statistics.mean_squares import (
    MeanSquares,
    root,
    spatial_mean_squares,
    temporal_mean_squares,
)
from ..statistics.outliers import Pixels, fill, note_left_out_pixels, outliers
from .curved_response import Curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Noise = tuple[MeanSquares | None, float]
"""Mean squares of the temporal noise of a mean frame (None for one frame), and the factor with which they are added."""

PAPER = "Konnik & Welsh 2014, PRNU"
CURVED_NOTE = "divided by the relative slope of the curved response"
MAYBE_CURVED_NOTE = (
    "the response may be curved; the interval includes PRNU divided by its slope"
)
PARTS = {"": "all", "_row": "row", "_col": "col", "_pixel": "pixel"}
"""Parts of mean squares, by the end of the symbol."""


@dataclass(frozen=True, eq=False)
class Nonuniformity(Figures):
    """Standard deviations of the fixed patterns of rows, columns, pixels and all of them together.

    dsnu, dsnu_row, dsnu_col, dsnu_pixel : patterns in the dark [DN].
    prnu, prnu_row, prnu_col, prnu_pixel : patterns in light, relative to the mean signal [%]; their squares are
    s²_light − s²_dark.
    paper_raw, paper : σ/µ of light minus dark [%], with and without the temporal noise that averaging leaves.
    difference : light minus dark without uneven light, shape (H, W) [DN].
    """

    dsnu: Quantity
    dsnu_row: Quantity
    dsnu_col: Quantity
    dsnu_pixel: Quantity
    prnu: Quantity
    prnu_row: Quantity
    prnu_col: Quantity
    prnu_pixel: Quantity
    paper_raw: Quantity
    paper: Quantity
    difference: Float64Array

    def plot(self, ax: Axes) -> None:
        """Plot the density of the pixels' deviations, and a normal distribution of the same standard deviation."""
        rest = (self.difference - self.difference.mean()).ravel()
        sigma = float(rest.std())
        bins = min(200, max(10, rest.size // 50))
        density, edges = np.histogram(rest, bins=bins, density=True)
        filled = density > 0
        centres = 0.5 * (edges[1:] + edges[:-1])
        ax.plot(centres[filled], density[filled], ".", label="measured")
        if sigma:
            x = np.linspace(edges[0], edges[-1], 400)
            normal = np.exp(-0.5 * (x / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
            ax.plot(x, normal, label="normal distribution")
        ax.set(
            xlabel="deviation from the mean signal [DN]", ylabel="density [1/DN]", yscale="log"
        )
        ax.set_ylim(bottom=0.5 * float(density[filled].min()))


def nonuniformity(dark: Stack, light: Stack, curve: Curve | None = None) -> Nonuniformity:
    """Measure DSNU1288 and PRNU1288 in dark frames and a flat field at half saturation, of the same exposure time.

    The intervals are for σ of the camera model, so they also apply to another sensor unit. Mean squares have the
    degrees of freedom of the analysis of variance, where EMVA 1288 divides by the number of lines, and temporal row and
    column noise is removed from rows and columns; both differences vanish for many lines and frames.

    Outlying pixels are left out, and a note gives their number and the figure with them: a few hot pixels would hide
    PRNU, which is a difference of two variances.

    If rows or columns show uneven light, PRNU is measured after the high-pass filter of EMVA 1288 R4 8.1, corrected for
    the variance that the filter removes, and a note gives the size.

    curve : response from emva_linear, to relate PRNU to the light. If the response may be a line or a curve, the
        interval includes both.

    Raises InputError for stacks that do not match, a mosaic, one pixel, and light that is not brighter than the dark.
    """
    _check(dark, light)
    difference = light.mean - dark.mean
    left_out = outliers(dark.mean) | outliers(difference)
    surface = uneven_light(fill(difference, left_out))
    measured = _measure_without(left_out, dark, light)
    whole = measured
    if left_out.any():
        whole = _measure_without(np.zeros_like(left_out), dark, light)
    note = note_left_out_pixels(left_out)
    uneven = ""
    if surface.any():
        uneven = f"the light is uneven by {100 * np.ptp(surface) / difference.mean():.2g} %"
        if min(light.shape) >= 4 * MARGIN + 2:
            filtered = _measure_without(left_out, dark, light, high_pass=True)
            measured |= {name: filtered[name] for name in filtered if name.startswith("prnu")}
            uneven += ", removed by the high-pass filter of EMVA 1288 R4 8.1"
        else:
            uneven += ", which is part of it"
    signal = float(difference.mean())
    flicker = flicker_dn(light) if len(light) > 1 else 0.0
    flicker_text = flicker_note(flicker, "PRNU and its row part may include it")
    figures: dict[str, Quantity] = {}
    for name, figure in measured.items():
        is_light = figure.unit == "%"
        stacks, per_dn = ((dark, light), 100 / signal) if is_light else ((dark,), 1.0)
        patterns = _patterns(name, stacks, measured, signal)
        if is_light:
            figure = figure.noted(uneven)
        if note and math.isfinite(figure.value):
            value = whole[name].value
            figure = figure.noted(f"{note}; {value:.4g} {figure.unit} with them")
        figure = mark_rounding(_mark(figure, *stacks), *patterns, per_dn=per_dn)
        if flicker and name in ("prnu", "prnu_row", "paper", "paper_raw"):
            hidden = flicker * (flicker + 2 * figure.high / per_dn) * per_dn**2
            figure = with_hidden(figure, hidden, flicker_text)
        if is_light and curve:
            figure = _of_light(figure, curve.relative_slope(signal))
        if is_light and curve is not None and curve.possible:
            other = _of_light(figure, curve.possible.relative_slope(signal))
            figure = figure.extended(other).noted(MAYBE_CURVED_NOTE)
        figures[name] = figure
    return Nonuniformity(**figures, difference=difference - surface)


def _patterns(
    name: str, stacks: Sequence[Stack], measured: Mapping[str, Quantity], signal: float
) -> Iterator[Pattern]:
    """Yield the spatial patterns of the dark and the lit stack that a figure is computed from."""
    end = name[4:] if name.startswith(("dsnu", "prnu")) else ""

    def sigmas(end: str) -> tuple[Quantity, Quantity]:
        dsnu, prnu = measured[f"dsnu{end}"], measured[f"prnu{end}"].scaled(signal / 100, "DN")
        low, high = math.hypot(dsnu.low, prnu.low), math.hypot(dsnu.high, prnu.high)
        return dsnu, dsnu.with_interval((math.nan, low, high))

    pixels = sigmas("_pixel") if end in ("_row", "_col") else (None, None)
    for stack, sigma, of_pixels in zip(stacks, sigmas(end), pixels, strict=False):
        yield Pattern(stack, sigma, of_pixels)


def _of_light(prnu: Quantity, slope: float) -> Quantity:
    """Return PRNU relative to the light, for a response with this relative slope."""
    return prnu.scaled(1 / slope, "%").noted(f"{CURVED_NOTE}, {slope:.4g}")


def _measure_without(
    left_out: Pixels, dark: Stack, light: Stack, high_pass: bool = False
) -> dict[str, Quantity]:
    """Return all figures by their names in Nonuniformity, without some pixels."""
    in_dark, in_light, power = fill(dark.mean, left_out), fill(light.mean, left_out), (1.0,) * 3
    percent = 100 / float((in_light - in_dark).mean())
    inside = left_out
    if high_pass:
        in_dark, in_light, power = highpass(in_dark), highpass(in_light), highpass_power()
        inside = left_out[MARGIN:-MARGIN, MARGIN:-MARGIN]
    difference, total = in_light - in_dark, in_light + in_dark
    filled = int(np.count_nonzero(inside))
    dark_squares = spatial_mean_squares(in_dark, filled=filled).divided(power)
    # The product of difference and sum of two images is the difference of their squares.
    light_less_dark_squares = spatial_mean_squares(difference, total, filled).divided(power)
    difference_squares = spatial_mean_squares(difference, filled=filled).divided(power)
    dark_noise, light_noise = _noise_of_mean(dark, left_out), _noise_of_mean(light, left_out)

    def sigma(
        part: str, measured: MeanSquares, *noises: Noise, scale: float = 1.0
    ) -> tuple[float, float, float]:
        """Return (value, low, high) of the standard deviation without this noise; no value if the noise is unknown."""
        left = measured.terms(part)
        if not left:
            return (math.nan,) * 3
        if any(noise is None for noise, _ in noises):
            return math.nan, 0.0, root(left, scale)[2]
        for noise, times in noises:
            left += [term.times(-times) for term in noise.terms(part)]  # type: ignore[union-attr]
        return root(left, scale)

    figures: dict[str, Quantity] = {}
    of_light = (light_noise, 1.0), (dark_noise, -1.0)
    for end, part in PARTS.items():
        equation = "eq. 42 and" if end else "eq."
        dsnu = sigma(part, dark_squares, (dark_noise, 1.0))
        prnu = sigma(part, light_less_dark_squares, *of_light, scale=percent)
        for symbol, name, interval, unit, number in (
            ("DSNU", "dark signal non-uniformity", dsnu, "DN", 66),
            ("PRNU", "photo response non-uniformity", prnu, "%", 67),
        ):
            figures[f"{symbol.lower()}{end}"] = Quantity(
                f"{symbol}1288{end}",
                name,
                *interval,
                unit,
                f"EMVA 1288 R4 {equation} {number}",
            )
    name = "standard deviation over mean, light minus dark"
    noises = (light_noise, 1.0), (dark_noise, 1.0)
    raw = sigma("all", difference_squares, scale=percent)
    spatial = sigma("all", difference_squares, *noises, scale=percent)
    figures["paper_raw"] = Quantity("σ/µ raw", name, *raw, "%", PAPER)
    figures["paper"] = Quantity("σ/µ", f"{name}, without temporal noise", *spatial, "%", PAPER)
    return figures


def _noise_of_mean(stack: Stack, left_out: Pixels) -> MeanSquares | None:
    """Return mean squares of the temporal noise in the mean frame; None for one frame."""
    frames = len(stack)
    if frames == 1:
        return None
    return temporal_mean_squares(stack, left_out).divided((frames, frames, frames))


def _mark(figure: Quantity, *stacks: Stack) -> Quantity:
    """Return the figure with notes on lines, frames, clipped values and a value of 0."""
    if math.isnan(figure.high):
        figure = figure.noted("rows, columns and pixels of a single line cannot be separated")
    figure = mark_clipped_sigma(figure, *stacks)
    if figure.low == 0 and all(len(stack) > 1 for stack in stacks):
        figure = figure.noted("may be 0")
    for stack in stacks:
        if len(stack) == 1:
            figure = figure.noted(ONE_FRAME)
    return figure


def _check(dark: Stack, light: Stack) -> None:
    """Raise InputError for stacks that do not match."""
    for stack in (dark, light):
        stack.require_one_filter()
    if dark.shape != light.shape or dark.exposure_s != light.exposure_s:
        raise InputError(
            f"dark frames of {dark.shape[0]} × {dark.shape[1]} pixels and {dark.exposure_s:g} s, light of "
            f"{light.shape[0]} × {light.shape[1]} and {light.exposure_s:g} s; pass the same size and exposure time."
        )
    if dark.mean.size < 2:
        raise InputError("the frames have one pixel; pass frames of at least 2 pixels.")
    signal = float(light.mean.mean() - dark.mean.mean())
    if signal <= 0:
        raise InputError(
            f"the light is {signal:g} DN brighter than the dark frames; pass the dark stack first, then the light."
        )


UNEVEN_MIN, UNEVEN_RATIO_MIN, UNEVEN_LINES_MIN = 0.01, 60.0, 16
"""Uneven light varies by 1 % of the signal and by 60 times the scatter of the line means (false alarm: 1e-5)."""
KERNEL = np.convolve(np.convolve(np.full(7, 1 / 7), np.full(11, 1 / 11)), (0.25, 0.5, 0.25))
"""Smoothing kernel along one axis: boxes of 7 and 11 pixels and a binomial of 3 (EMVA 1288 R4 8.1)."""
MARGIN = len(KERNEL) // 2
"""Width of the border whose neighbourhood is incomplete [px]."""


def uneven_light(image: Float64Array) -> Float64Array:
    """Return significant parabolas along rows and columns of an image, minus its mean, shape (H, W); else zeros."""
    surface = np.zeros(image.shape)
    for axis in (0, 1):
        profile = image.mean(axis=1 - axis)
        if profile.size < UNEVEN_LINES_MIN:
            continue
        place = np.linspace(-1, 1, profile.size)
        parabola = np.polynomial.polynomial.polyval(
            place, np.polynomial.polynomial.polyfit(place, profile, 2)
        )
        rest = float(np.square(profile - parabola).sum()) / (profile.size - 3)
        parabola -= parabola.mean()
        is_large = np.ptp(parabola) > UNEVEN_MIN * abs(image.mean())
        if is_large and float(parabola @ parabola) > UNEVEN_RATIO_MIN * rest:
            surface += np.expand_dims(parabola, 1 - axis)
    return surface


def highpass(image: Float64Array) -> Float64Array:
    """Return the image minus its smooth part without a margin of 9 pixels, shape (H − 18, W − 18)."""
    smooth = image
    for axis in (0, 1):
        smooth = scipy.ndimage.convolve1d(smooth, KERNEL, axis=axis, mode="reflect")
    inside = (slice(MARGIN, -MARGIN),) * 2
    return np.asarray(image[inside] - smooth[inside])


def highpass_power() -> tuple[float, float, float]:
    """Return the fraction of the variance that the filter leaves of independent rows, columns and pixels."""
    centre, power = KERNEL[MARGIN], float(KERNEL @ KERNEL)
    line, pixel = 1 - 2 * centre + power, 1 - 2 * centre**2 + power**2
    return line, line, pixel
