"""Relative illumination and colour shading under uniform illumination (ISO 17957)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers
from ....core.types import Float64Array
from ...quantity import Figures, Quantity, student_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "ISO 17957"
ORDER = 8
"""Order of the polynomial that describes the light over the field."""
BLOCKS_MAX = 48
"""Largest number of blocks of pixels along each side, whose means are fitted."""
SIDE_MIN = 16
CORNERS = np.array([[0.0, 0.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
"""Centre and corners (x, y), in halves of the image."""


class _Field(NamedTuple):
    """Light in the centre and the corners, with its covariance (5, 5) and degrees of freedom."""

    values: Float64Array
    covariance: Float64Array
    freedom: int
    coefficients: Float64Array


@dataclass(frozen=True, eq=False)
class FlatField(Figures):
    """Results of a flat field.

    illumination : corners over centre, for each channel [%].
    shading : ratio of each channel to the second, in the corners relative to the centre, minus 1 [%].
    fields : coefficients of the fitted polynomial of each channel.  names : of the channels.
    """

    illumination: tuple[Quantity, ...]
    shading: tuple[Quantity, ...]
    fields: tuple[Float64Array, ...]
    names: tuple[str, ...]

    def plot(self, ax: Axes) -> None:
        """Plot the light along the diagonal, relative to the centre."""
        place = np.linspace(0.0, 1.0, 101)
        for name, coefficients in zip(self.names, self.fields, strict=True):
            light = _powers(place, place) @ coefficients
            ax.plot(place, 100 * light / light[0], label=name)
        ax.set(xlabel="image height, 1 in the corner", ylabel="relative illumination [%]")
        ax.set_ylim(0, None)


def flat_field(planes: ArrayLike, names: Sequence[str] = ()) -> FlatField:
    """Measure relative illumination and colour shading in an image of a uniformly lit surface.

    ::

        y, x = np.mgrid[-1:1:64j, -1:1:96j]
        light = 1000 / (1 + 0.1 * (x**2 + y**2)) ** 2
        print(ms.lab.flat_field(light).illumination[0])

    planes : mean of several frames, linear values without the black level, shape (H, W), or (H, W, C) for channels red,
        green, blue, ….
    names : of the channels, for figures and plot, e.g. ``("R", "G", "B")``. Default: channel 0, channel 1, ….
    Raises InputError for images of fewer than 16 × 16 pixels, and for images that are dark in the centre or a corner.
    """
    wanted = f"values (rows, columns) or (rows, columns, channels) of {SIDE_MIN} × {SIDE_MIN} pixels or more"
    pixels = finite_numbers("planes", planes, wanted)
    if pixels.ndim == 2:
        pixels = pixels[..., None]
    if pixels.ndim != 3 or min(pixels.shape[:2]) < SIDE_MIN or not pixels.shape[2]:
        raise InputError(f"planes has shape {pixels.shape}; pass {wanted}.")
    count = pixels.shape[2]
    names = tuple(names) or tuple(f"channel {number}" for number in range(count))
    if len(names) != count:
        raise InputError(
            f"names has {', '.join(names)} for {count} channels; give one name each."
        )
    fields = [_fit_field(plane) for plane in np.moveaxis(pixels, 2, 0)]
    if not min(field.values.min() for field in fields) > 0:
        raise InputError(
            "planes is dark in the centre or a corner; pass light above the black level."
        )
    illumination = tuple(_relative(field, n, names) for n, field in enumerate(fields))
    others = [number for number in range(count) if number != 1 and count > 1]
    shading = tuple(_shading(fields[n], fields[1], n, names) for n in others)
    coefficients = tuple(field.coefficients for field in fields)
    return FlatField(illumination, shading, coefficients, names)


def _powers(x: Float64Array, y: Float64Array) -> Float64Array:
    """Return products of Legendre polynomials up to the order, shape (N, k)."""
    columns = np.polynomial.legendre.legvander2d(x, y, [ORDER, ORDER])
    total = np.add.outer(np.arange(ORDER + 1), np.arange(ORDER + 1)).ravel()
    return np.asarray(columns[:, total <= ORDER])


def _fit_field(plane: Float64Array) -> _Field:
    """Fit a polynomial to the means of blocks of pixels."""
    blocks = [min(count // 2, BLOCKS_MAX) for count in plane.shape]
    edges = [
        np.linspace(0, n, b + 1).astype(int) for n, b in zip(plane.shape, blocks, strict=True)
    ]
    sums = np.add.reduceat(np.add.reduceat(plane, edges[0][:-1], 0), edges[1][:-1], 1)
    sizes = np.outer(np.diff(edges[0]), np.diff(edges[1])).astype(float)
    middles = [(e[1:] + e[:-1]) / n - 1 for e, n in zip(edges, plane.shape, strict=True)]
    y, x = np.meshgrid(*middles, indexing="ij")
    weight = np.sqrt(sizes / sizes.mean()).ravel()
    design = _powers(x.ravel(), y.ravel()) * weight[:, None]
    values = (sums / sizes).ravel() * weight
    inverse = np.linalg.inv(design.T @ design)
    coefficients = inverse @ (design.T @ values)
    residual = values - design @ coefficients
    freedom = values.size - design.shape[1]
    variance = float(residual @ residual) / freedom
    ends = _powers(*CORNERS.T)
    covariance = variance * ends @ inverse @ ends.T
    return _Field(ends @ coefficients, covariance, freedom, coefficients)


def _relative(field: _Field, number: int, names: Sequence[str]) -> Quantity:
    """Return the mean of the corners over the centre."""
    ratio, error = _corners_over_centre(field)
    name = f"relative illumination of the corners, {names[number]}"
    interval = student_interval(100 * ratio, 100 * error, field.freedom)
    return Quantity(f"RI_{number}", name, *interval, "%", SECTION)


def _corners_over_centre(field: _Field) -> tuple[float, float]:
    """Return the mean of the corners over the centre, and its standard error."""
    centre, corners = field.values[0], field.values[1:].mean()
    ratio = float(corners / centre)
    slopes = np.array([-ratio, 0.25, 0.25, 0.25, 0.25]) / centre
    return ratio, float(np.sqrt(slopes @ field.covariance @ slopes))


def _shading(field: _Field, green: _Field, number: int, names: Sequence[str]) -> Quantity:
    """Return the ratio of a channel to green in the corners, relative to the centre, minus 1."""
    channel, channel_error = _corners_over_centre(field)
    reference, reference_error = _corners_over_centre(green)
    ratio = channel / reference
    error = ratio * float(np.hypot(channel_error / channel, reference_error / reference))
    name = f"colour shading, {names[number]} over {names[1]}"
    interval = student_interval(100 * (ratio - 1), 100 * error, field.freedom)
    return Quantity(f"CS_{number}", name, *interval, "%", SECTION)
