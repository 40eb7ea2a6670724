"""A chart of known colours: ΔE00 after a fitted colour matrix, and the error of the white balance on its greys."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers
from ....core.errors import shown
from ....core.types import Float64Array
from ....optics import spectra
from ...quantity import LEVEL, Figures, Quantity, normal_interval
from ..image_quality.patches import (
    Region,
    require_regions,
    slices_of,
    variance_about_plane,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "CIE 142:2001 ΔE00"
BALANCE = "sum over the grey patches"
GREYS = tuple(range(18, 24))
"""Neutral patches of a ColorChecker, from white to black."""
DRAWS, SEED = 400, 2000
"""Number of draws of the patches' noise, and their seed."""
XYZ_STEP = 1e-6
"""Step of XYZ for the slopes of CIELAB; white has Y = 1."""


@dataclass(frozen=True, eq=False)
class ColourChart(Figures):
    """Results of a chart of known colours.

    measured_lab, reference_lab : CIELAB of the patches in daylight, shape (P, 3).  colours : of the reference in sRGB.
    matrix : from values to XYZ, (3, C).
    delta_e : ΔE00 of each patch including noise, (P,).  mean, largest : of these, without the contribution of noise.
    balance : error of the white balance of each channel relative to the second [%].
    """

    measured_lab: Float64Array
    reference_lab: Float64Array
    colours: Float64Array
    matrix: Float64Array
    delta_e: Float64Array
    mean: Quantity
    largest: Quantity
    balance: tuple[Quantity, ...]

    def plot(self, ax: Axes) -> None:
        """Plot the patches in the a*b* plane: circles for the reference, lines to the colours of the camera."""
        reference, measured = self.reference_lab[:, 1:].T, self.measured_lab[:, 1:].T
        ax.plot([reference[0], measured[0]], [reference[1], measured[1]], color="0.4", lw=1)
        ax.scatter(
            reference[0],
            reference[1],
            c=self.colours,
            s=60,
            edgecolors="0.4",
            label="reference",
        )
        ax.scatter(measured[0], measured[1], c="k", s=6, label="camera")
        ax.set(xlabel="a*", ylabel="b*")
        ax.set_aspect("equal")


class _Patches(NamedTuple):
    """Means of the patches and their standard errors, shape (P, C) each."""

    values: Float64Array
    errors: Float64Array


class _Fit(NamedTuple):
    """matrix : (3, C).  lab : CIELAB, (P, 3).  noise : influence of each value on CIELAB, (3P, P·C)."""

    matrix: Float64Array
    lab: Float64Array
    noise: Float64Array


def colour_chart(
    planes: ArrayLike,
    regions: Sequence[Region],
    *,
    reference_xyz: ArrayLike | None = None,
    greys: Sequence[int] = GREYS,
    white_balance: ArrayLike | None = None,
) -> ColourChart:
    """Measure colour differences after the best 3 × C matrix, and the error of the white balance.

    ::

        xyz = np.random.default_rng(1).uniform(0.1, 0.9, (24, 3))
        planes = 3000 * np.repeat(xyz, 16, axis=0)[None] * np.ones((16, 1, 1))
        regions = [(0, 16 * number, 16, 16) for number in range(24)]
        chart = ms.lab.colour_chart(planes, regions, reference_xyz=xyz)
        print(chart.mean)

    planes : linear values without the black level, shape (H, W, C), in at least 3 channels: red, green, blue, …; for a
        mosaic the planes of its filters, np.stack([r, g, b], axis=2).
    regions : (first row, first column, rows, columns) of each patch.
    reference_xyz : XYZ of the patches in daylight (D65), (P, 3), white has Y = 1. Default: ColorChecker (ISO 17321-1).
    greys : numbers of at least two neutral patches, the brightest first; () for no white balance.
    white_balance : factors that the camera states, (C,). Default: from the brightest grey.
    Raises InputError for patches outside of the planes, patches clipped to 0, and too few patches for the matrix.
    """
    if reference_xyz is None:
        reference_xyz = spectra.color_checker_xyz()
    reference = finite_numbers("reference_xyz", reference_xyz, "XYZ of each patch, (P, 3)")
    wanted = "values (rows, columns, channels), three channels or more"
    pixels = finite_numbers("planes", planes, wanted)
    if pixels.ndim != 3 or pixels.shape[2] < 3:
        raise InputError(f"planes has shape {pixels.shape}; pass {wanted}.")
    regions, least = require_regions(regions), pixels.shape[2] + 1
    if reference.shape != (len(regions), 3) or len(regions) < least:
        raise InputError(
            f"reference_xyz has shape {reference.shape} for {len(regions)} patches; pass (P, 3) for at least {least}."
        )
    if not (reference > 0).all():
        raise InputError(
            f"reference_xyz has values from {reference.min():g}; pass values above 0 for each patch."
        )
    patches = _measure(pixels, regions)
    fit = _fit_matrix(patches.values, reference)
    reference_lab = spectra.lab(reference)
    mean, largest = _differences(fit, patches.errors, reference_lab)
    balance = _balance(patches, greys, white_balance)
    delta_e = spectra.delta_e_2000(fit.lab, reference_lab)
    colours = spectra.srgb_curve(np.clip(reference @ spectra.XYZ_TO_SRGB.T, 0, 1))
    return ColourChart(
        fit.lab, reference_lab, colours, fit.matrix, delta_e, mean, largest, balance
    )


def _measure(pixels: Float64Array, regions: Sequence[Region]) -> _Patches:
    """Return the mean of each patch and its standard error, from the scatter of its pixels about a plane."""
    values, errors = [], []
    for region in regions:
        part = pixels[slices_of(region, pixels.shape)]
        mean = part.mean(axis=(0, 1))
        if not (mean > 0).all():
            raise InputError(
                f"the patch {tuple(region)} has means {mean}; every channel must be above 0, the black level."
            )
        variance = [variance_about_plane(plane) for plane in np.moveaxis(part, 2, 0)]
        values.append(mean)
        errors.append(np.sqrt(np.array(variance) / part[..., 0].size))
    return _Patches(np.array(values), np.array(errors))


def _fit_matrix(values: Float64Array, reference: Float64Array) -> _Fit:
    """Return the matrix with the least sum of squared distances in CIELAB."""
    target = spectra.lab(reference)
    channels = values.shape[1]
    weight = 1 / np.sqrt(reference[:, 1:2])
    brightest = values.max()
    shares = values / brightest
    start = np.linalg.lstsq(shares * weight, reference * weight, rcond=None)[0].T

    def residual(flat: Float64Array) -> Float64Array:
        return np.asarray((spectra.lab(shares @ flat.reshape(3, channels).T) - target).ravel())

    solution = scipy.optimize.least_squares(residual, start.ravel(), xtol=1e-12, ftol=1e-12)
    matrix = solution.x.reshape(3, channels) / brightest
    slopes = _lab_slopes(values @ matrix.T)
    count = len(values)
    by_matrix = np.einsum("plk,pc->plkc", slopes, values).reshape(3 * count, -1)
    by_value = np.zeros((count, 3, count, channels))
    by_value[np.arange(count), :, np.arange(count)] = slopes @ matrix
    flat = by_value.reshape(3 * count, -1)
    refitted = by_matrix @ np.linalg.lstsq(by_matrix, flat, rcond=None)[0]
    return _Fit(matrix, spectra.lab(values @ matrix.T), flat - refitted)


def _lab_slopes(xyz: Float64Array) -> Float64Array:
    """Return the derivatives of CIELAB by X, Y and Z, shape (P, 3, 3)."""
    steps = XYZ_STEP * np.eye(3)[:, None]
    change = np.array([spectra.lab(xyz + step) - spectra.lab(xyz - step) for step in steps])
    return np.asarray(change.transpose(1, 2, 0) / (2 * XYZ_STEP))


def _differences(
    fit: _Fit, errors: Float64Array, reference: Float64Array
) -> tuple[Quantity, Quantity]:
    """Return mean and largest ΔE00.  errors : standard errors of the patches' values, (P, C).

    The contribution of noise is subtracted; drawing the noise once more gives its size. If all distances may be noise
    (χ² at 5 %), the intervals begin at 0.
    """
    influence = fit.noise * errors.ravel()
    draws = np.random.default_rng(SEED).normal(size=(DRAWS, influence.shape[1])) @ influence.T
    drawn = spectra.delta_e_2000(fit.lab + draws.reshape(DRAWS, *fit.lab.shape), reference)
    measured = spectra.delta_e_2000(fit.lab, reference)
    distance = (fit.lab - reference).ravel()
    freedom = distance.size - fit.matrix.size
    weighted = np.linalg.lstsq(influence, distance, rcond=1e-9)[0]
    unexplained = np.abs(influence @ weighted - distance).max()
    may_be_noise = unexplained < 1e-3 and _is_chance(float(weighted @ weighted), freedom)

    def quantity(symbol: str, name: str, value: float, noisy: Float64Array) -> Quantity:
        error = float(noisy.std(ddof=1))
        value = max(2 * value - float(noisy.mean()), 0.0)
        low, high = normal_interval(value, error)[1:]
        if may_be_noise:
            low = 0.0
        return Quantity(symbol, name, value, max(low, 0.0), high, "", SECTION)

    mean = quantity("ΔE00", "mean ΔE00", float(measured.mean()), drawn.mean(axis=1))
    largest = quantity(
        "ΔE00_max", "largest ΔE00", float(measured.max()), drawn[:, int(measured.argmax())]
    )
    return mean, largest


def _is_chance(square: float, freedom: int) -> bool:
    """Return True if such a large sum of squares of normal values has a probability above 5 %."""
    return square < float(scipy.special.chdtri(freedom, 1 - LEVEL))


def _balance(
    patches: _Patches, greys: Sequence[int], white_balance: ArrayLike | None
) -> tuple[Quantity, ...]:
    """Return the deviation of each balanced channel, summed over the greys, from the second channel [%]."""
    count = len(patches.values)
    try:
        numbers = [operator.index(grey) for grey in greys]
    except TypeError:  # not whole numbers
        numbers = [-1]
    if not numbers:
        return ()
    if not set(numbers) <= set(range(count)) or len(set(numbers)) < 2:
        raise InputError(
            f"greys is {shown(greys)}; pass numbers of at least two patches, from 0 to {count - 1}, or ()."
        )
    first, rest = numbers[0], numbers[1:]
    factors = patches.values[first, 1] / patches.values[first]
    shared = np.square(patches.errors[first] / patches.values[first])
    if white_balance is not None:
        factors = finite_numbers("white_balance", white_balance, "a factor for each channel")
        if factors.shape != patches.values.shape[1:] or not (factors > 0).all():
            raise InputError(
                f"white_balance has shape {factors.shape}; pass a factor above 0 for each of the "
                f"{patches.values.shape[1]} channels."
            )
        rest, shared = numbers, np.zeros_like(factors)
    total = patches.values[rest].sum(axis=0)
    relative = np.square(patches.errors[rest]).sum(axis=0) / total**2 + shared
    quantities = []
    for channel in [number for number in range(len(factors)) if number != 1]:
        ratio = total[channel] * factors[channel] / (total[1] * factors[1])
        error = ratio * np.sqrt(relative[channel] + relative[1])
        name = f"error of the white balance, channel {channel}"
        interval = normal_interval(100 * (ratio - 1), 100 * float(error))
        quantities.append(Quantity(f"WB_{channel}", name, *interval, "%", BALANCE))
    return tuple(quantities)
