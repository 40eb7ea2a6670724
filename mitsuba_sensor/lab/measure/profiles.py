"""Horizontal and vertical profiles of an image: mean, smallest and largest value of its lines, and the middle line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import mark_clipped
from ..frames.stack import Stack
from ..quantity import Quantity, no_value
from ..statistics.line_fits import straight_line
from ..statistics.outliers import fill, note_left_out_pixels, outliers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 8.7"


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile along one direction of an image of H × W pixels.

    direction : "horizontal", with (W,) values of the columns, or "vertical", with (H,) values of the rows.
    mean, smallest, largest, middle : over the pixels of each line, and of the middle row or column [DN].
    slope : change of a straight line through the means over the whole length [DN].
    """

    direction: str
    mean: Float64Array
    smallest: Float64Array
    largest: Float64Array
    middle: Float64Array
    slope: Quantity

    def plot(self, ax: Axes) -> None:
        """Plot the four curves versus the line number."""
        for name in ("largest", "middle", "mean", "smallest"):
            ax.plot(getattr(self, name), lw=1.6 if name == "mean" else 0.8, label=name)
        line = "column" if self.direction == "horizontal" else "row"
        ax.set(xlabel=f"{line} number", ylabel="value [DN]")


def profiles(stack: Stack, dark: Stack | None = None) -> tuple[Profile, Profile]:
    """Return the horizontal and the vertical profile of the mean of a stack, minus dark frames.

    Outlying pixels are left out of the line means, and a note counts them.
    Raises InputError for a mosaic, and for a dark stack of another size.
    """
    stack.require_one_filter()
    image, stacks = stack.mean, [stack]
    if dark is not None:
        if dark.shape != stack.shape:
            raise InputError(
                f"dark has shape {dark.shape} and stack {stack.shape}; pass frames of equal size."
            )
        image = image - dark.mean
        stacks.append(dark)
    left_out = outliers(image)
    filled, note = fill(image, left_out), note_left_out_pixels(left_out)

    def profile(direction: str, along: str, image: Float64Array, mean: Float64Array) -> Profile:
        slope = no_value(f"Δ_{direction}", f"change along the {along}", "DN", SECTION)
        if len(mean) < 3:
            slope = slope.noted("needs at least 3 lines")
        else:
            # The interval comes from the scatter of the lines, which includes their fixed pattern.
            place = np.linspace(-0.5, 0.5, len(mean))
            line = straight_line(place, mean, np.full(len(mean), np.nan))
            slope = slope.with_interval(line.interval)
        slope = mark_clipped(slope.noted(note), *stacks)
        middle = image[image.shape[0] // 2]
        return Profile(direction, mean, image.min(axis=0), image.max(axis=0), middle, slope)

    return (
        profile("horizontal", "rows", image, filled.mean(axis=0)),
        profile("vertical", "columns", image.T, filled.mean(axis=1)),
    )
