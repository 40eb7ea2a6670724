"""Spatial non-uniformity in the dark and in light (DSNU1288, PRNU1288), split into rows, columns and pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped_sigma, mark_rounding
from ..frames.stack import ONE_FRAME, Stack
from ..frames.temporal import flicker_note
from ..quantity import Figures, Quantity, unknown
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
"""Mean squares of temporal noise over the number of frames, None for one frame; and how often they are added."""

PAPER = "Konnik & Welsh 2014, PRNU"
OF_LIGHT = "divided by the relative slope of the response, which is curved"
MAYBE_OF_LIGHT = "the response may be curved; the interval holds PRNU divided by its slope"
PARTS = {"": "all", "_row": "row", "_col": "col", "_pixel": "pixel"}
"""Ends of symbols, and parts of mean squares."""


@dataclass(frozen=True, eq=False)
class Nonuniformity(Figures):
    """Standard deviations over rows, columns and pixels of what does not change from frame to frame.

    dsnu, dsnu_row, dsnu_col, dsnu_pixel : in the dark [DN].
    prnu, prnu_row, prnu_col, prnu_pixel : in light, of the mean signal [%]; their squares are s²_light − s²_dark.
    paper_raw, paper : σ/µ of the light minus the dark [%], with and without what averaging leaves of temporal noise.
    difference : light minus dark, (H, W) [DN], without uneven light.
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
        """Density of the pixels' deviation from the mean signal, and the normal law of the same standard deviation."""
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
            ax.plot(x, normal, label="normal law")
        ax.set(
            xlabel="deviation from the mean signal [DN]", ylabel="density [1/DN]", yscale="log"
        )
        ax.set_ylim(bottom=0.5 * float(density[filled].min()))


def nonuniformity(
    dark: Stack, light: Stack, high_pass: bool | None = None, curve: Curve | None = None
) -> Nonuniformity:
    """DSNU1288 and PRNU1288 of a dark stack and one of a flat field at half saturation, of the same exposure time.

    The intervals are those of σ of the camera's model: another chip of it would lie in them too. Mean squares have the
    degrees of freedom of the analysis of variance, where EMVA 1288 divides by the number of lines, and temporal row and
    column noise is removed from rows and columns as well: both vanish for many lines and frames.

    Pixels that stand out in the dark or in the light are left out, and a note says how many and what the figure is with
    them: a handful of hot pixels would hide PRNU, which is a difference of two variances.

    high_pass : removes uneven light as EMVA 1288 R4 8.1 does, and corrects for what the filter takes of each part. None
        does so for PRNU where rows or columns show that the light is uneven, and a note says by how much.
    curve : of the response, as emva_linear finds it: PRNU is then that of the light. Of a curve that is not told from a
        line, PRNU has an interval that holds both.

    Raises InputError for stacks that do not fit, a mosaic, one pixel, and light that is not brighter than the dark.
    """
    _check(dark, light)
    difference = light.mean - dark.mean
    left_out = outliers(dark.mean) | outliers(difference)
    surface = uneven_light(fill(difference, left_out))
    measured = _measure_without(left_out, dark, light, bool(high_pass))
    whole = measured
    if left_out.any():
        whole = _measure_without(np.zeros_like(left_out), dark, light, bool(high_pass))
    note = note_left_out_pixels(left_out)
    uneven = ""
    if high_pass is None and surface.any():
        uneven = f"the light is uneven by {100 * np.ptp(surface) / difference.mean():.2g} %"
        if min(light.shape) >= 4 * MARGIN + 2:
            filtered = _measure_without(left_out, dark, light, True)
            measured |= {name: filtered[name] for name in filtered if name.startswith("prnu")}
            uneven += ", removed by the high-pass filter of EMVA 1288 R4 8.1"
        else:
            uneven += ", which is part of it"
    signal = float(difference.mean())
    flicker = flicker_note(light, "PRNU of rows and of all is not told from it")
    figures: dict[str, Quantity] = {}
    for name, figure in measured.items():
        is_light = figure.unit == "%"
        stacks, per_dn = ((dark, light), 100 / signal) if is_light else ((dark,), 1.0)
        if is_light:
            figure = figure.noted(uneven)
        if note and math.isfinite(figure.value):
            value = whole[name].value
            figure = figure.noted(f"{note}; {value:.4g} {figure.unit} with them")
        figure = mark_rounding(_mark(figure, *stacks), *stacks, per_dn=per_dn)
        if flicker and name in ("prnu", "prnu_row", "paper", "paper_raw"):
            figure = unknown(figure, flicker)
        if is_light and curve:
            figure = _of_light(figure, curve.relative_slope(signal))
        if is_light and curve is not None and curve.possible:
            other = _of_light(figure, curve.possible.relative_slope(signal))
            figure = figure.extended(other).noted(MAYBE_OF_LIGHT)
        figures[name] = figure
    return Nonuniformity(**figures, difference=difference - surface)


def _of_light(prnu: Quantity, slope: float) -> Quantity:
    """PRNU of the light where the response has this relative slope."""
    return prnu.scaled(1 / slope, "%").noted(f"{OF_LIGHT}, by {slope:.4g}")


def _measure_without(
    left_out: Pixels, dark: Stack, light: Stack, high_pass: bool
) -> dict[str, Quantity]:
    """All figures by their names in Nonuniformity, without some pixels."""
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
        """(value, low, high) of the standard deviation without so much noise; no value if that is not known."""
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
    """Mean squares of temporal noise in the mean of the frames; None for one frame."""
    frames = len(stack)
    if frames == 1:
        return None
    return temporal_mean_squares(stack, left_out).divided((frames, frames, frames))


def _mark(figure: Quantity, *stacks: Stack) -> Quantity:
    """The figure with what restricts it: lines, frames, clipped values, rounding, a value of 0."""
    if math.isnan(figure.high):
        figure = figure.noted(
            "a single line of pixels: rows, columns and pixels are not told apart"
        )
    figure = mark_clipped_sigma(figure, *stacks)
    if figure.low == 0 and all(len(stack) > 1 for stack in stacks):
        figure = figure.noted("not told from 0")
    for stack in stacks:
        if len(stack) == 1:
            figure = figure.noted(ONE_FRAME)
    return figure


def _check(dark: Stack, light: Stack) -> None:
    """Raises InputError for stacks that do not fit."""
    for stack in (dark, light):
        stack.require_one_filter()
    if dark.shape != light.shape or dark.exposure_s != light.exposure_s:
        raise InputError(
            f"dark frames of {dark.shape[0]} × {dark.shape[1]} pixels and {dark.exposure_s:g} s, light of "
            f"{light.shape[0]} × {light.shape[1]} and {light.exposure_s:g} s; pass the same size and exposure time."
        )
    if dark.mean.size < 2:
        raise InputError("one pixel has no non-uniformity; pass frames of at least 2 pixels.")
    signal = float(light.mean.mean() - dark.mean.mean())
    if signal <= 0:
        raise InputError(
            f"the light is {signal:g} DN brighter than the dark; pass the dark stack first, then light."
        )


LEAST_UNEVEN, CLEARLY_UNEVEN, FEWEST_LINES = 0.01, 60.0, 16
"""Light is uneven by 1 % of the signal or more, and 60 times the scatter of the lines' means: chance 1e-5."""
KERNEL = np.convolve(np.convolve(np.full(7, 1 / 7), np.full(11, 1 / 11)), (0.25, 0.5, 0.25))
"""Along one axis: boxes of 7 and 11 pixels and a binomial of 3, which are smoothed with and subtracted (EMVA 1288 R4
8.1)."""
MARGIN = len(KERNEL) // 2
"""Pixels at each border whose neighbourhood is not complete."""


def uneven_light(image: Float64Array) -> Float64Array:
    """Parabolas along rows and columns of an image, less its mean, where they are no chance, (H, W); else zeros."""
    surface = np.zeros(image.shape)
    for axis in (0, 1):
        profile = image.mean(axis=1 - axis)
        if profile.size < FEWEST_LINES:
            continue
        place = np.linspace(-1, 1, profile.size)
        parabola = np.polynomial.polynomial.polyval(
            place, np.polynomial.polynomial.polyfit(place, profile, 2)
        )
        rest = float(np.square(profile - parabola).sum()) / (profile.size - 3)
        parabola -= parabola.mean()
        is_large = np.ptp(parabola) > LEAST_UNEVEN * abs(image.mean())
        if is_large and float(parabola @ parabola) > CLEARLY_UNEVEN * rest:
            surface += np.expand_dims(parabola, 1 - axis)
    return surface


def highpass(image: Float64Array) -> Float64Array:
    """The image less its smooth part, without a margin of 9 pixels, (H, W) → (H − 18, W − 18).

    Raises InputError for an image of fewer than 38 rows or columns, half of which would be margin.
    """
    if min(image.shape) < 4 * MARGIN + 2:
        raise InputError(
            f"the image is {image.shape[0]} × {image.shape[1]}; the high-pass filter needs at least "
            f"{4 * MARGIN + 2} rows and columns. Leave high_pass out."
        )
    smooth = image
    for axis in (0, 1):
        smooth = scipy.ndimage.convolve1d(smooth, KERNEL, axis=axis, mode="reflect")
    inside = (slice(MARGIN, -MARGIN),) * 2
    return np.asarray(image[inside] - smooth[inside])


def highpass_power() -> tuple[float, float, float]:
    """Share of the variance that is left of independent rows, columns and pixels."""
    centre, power = KERNEL[MARGIN], float(KERNEL @ KERNEL)
    line, pixel = 1 - 2 * centre + power, 1 - 2 * centre**2 + power**2
    return line, line, pixel
