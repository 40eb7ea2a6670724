"""Checks of the pictures that instruments take: linear values of two dimensions without the black level."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers
from ....core.types import Float64Array


def picture_of(picture: ArrayLike, name: str = "picture") -> Float64Array:
    """A picture (H, W) as float64; raises InputError for another shape and for values that are not finite.

    name : of the argument.
    """
    wanted = "values (rows, columns), e.g. stack.mean − the black level"
    pixels = finite_numbers(name, picture, wanted)
    if pixels.ndim != 2 or min(pixels.shape) < 2:
        raise InputError(f"{name} has shape {pixels.shape}; pass {wanted}.")
    return pixels


def flat_fielded(picture: Float64Array, flat: ArrayLike | None) -> Float64Array:
    """The picture over a flat field whose mean is made 1; raises InputError where that has another shape or is dark."""
    if flat is None:
        return picture
    light = picture_of(flat, "flat")
    if light.shape != picture.shape or not light.min() > 0:
        raise InputError(
            f"flat has shape {light.shape} and values from {light.min():g}; pass positive values of the picture's "
            f"shape {picture.shape}."
        )
    return np.asarray(picture * (light.mean() / light))
