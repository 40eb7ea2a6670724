"""Horizontal and vertical profiles of an image: mean, smallest and largest value of its lines, and the middle line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Quantity, no_value, student_interval
from ..statistics.outliers import fill, note_left_out_pixels, outliers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 8.7"


@dataclass(frozen=True, eq=False)
class Profile:
    """Along one direction of an image of H × W pixels.

    direction : "horizontal", (W,) values of the columns, or "vertical", (H,) values of the rows.
    mean, smallest, largest, middle : over the pixels of each line, and of the row or column in the middle [DN].
    slope : of the straight line through the means, over the whole length [DN]: uneven light or a gradient in the dark.
    """

    direction: str
    mean: Float64Array
    smallest: Float64Array
    largest: Float64Array
    middle: Float64Array
    slope: Quantity

    def plot(self, ax: Axes) -> None:
        """The four curves against the number of the pixel."""
        for name in ("largest", "middle", "mean", "smallest"):
            width = 0.8
            if name == "mean":
                width = 1.6
            ax.plot(getattr(self, name), lw=width, label=name)
        line = "row"
        if self.direction == "horizontal":
            line = "column"
        ax.set(xlabel=f"number of the {line}", ylabel="value [DN]")


def profiles(stack: Stack, dark: Stack | None = None) -> tuple[Profile, Profile]:
    """Horizontal and vertical profile of the mean of a stack.  dark : what is subtracted, as for PRNU.

    The means of the lines are without pixels that stand out, and a note says how many these are.

    Raises InputError for a mosaic, and for a dark stack of another size.
    """
    stack.require_one_filter()
    image, stacks = stack.mean, [stack]
    if dark is not None:
        if dark.shape != stack.shape:
            raise InputError(
                f"the dark frames have shape {dark.shape}, the others {stack.shape}; pass the same size."
            )
        image = image - dark.mean
        stacks.append(dark)
    left_out = outliers(image)
    filled, note = fill(image, left_out), note_left_out_pixels(left_out)
    horizontal = _profile("horizontal", image, filled)
    vertical = _profile("vertical", image.T, filled.T)
    return (
        replace(horizontal, slope=mark_clipped(horizontal.slope.noted(note), *stacks)),
        replace(vertical, slope=mark_clipped(vertical.slope.noted(note), *stacks)),
    )


def _profile(direction: str, image: Float64Array, filled: Float64Array) -> Profile:
    """Profile along the second direction of an image, with the means of that without pixels that stand out."""
    mean = filled.mean(axis=0)
    return Profile(
        direction=direction,
        mean=mean,
        smallest=image.min(axis=0),
        largest=image.max(axis=0),
        middle=image[image.shape[0] // 2],
        slope=_slope(direction, mean),
    )


def _slope(direction: str, mean: Float64Array) -> Quantity:
    """Least squares; the interval from the scatter of the lines about the straight line, which FPN of lines makes."""
    count = len(mean)
    along = "columns"
    if direction == "horizontal":
        along = "rows"
    symbol, name = f"Δ_{direction}", f"change along the {along}"
    if count < 3:
        return no_value(symbol, name, "DN", SECTION, "needs 3 lines at least")
    place = np.linspace(-0.5, 0.5, count)
    power = float(place @ place)
    slope = float(place @ mean) / power
    rest = mean - mean.mean() - slope * place
    error = float(np.sqrt(rest @ rest / (count - 2) / power))
    return Quantity(symbol, name, *student_interval(slope, error, count - 2), "DN", SECTION)
