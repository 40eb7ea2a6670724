"""Checks of the pictures that instruments take: linear values of two dimensions without the black level."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, numbers
from ....core.types import Float64Array


def picture_of(picture: ArrayLike) -> Float64Array:
    """A picture (H, W) as float64; raises InputError for another shape and for values that are not finite."""
    pixels = np.asarray(numbers("picture", picture, "values (rows, columns), e.g. stack.mean"))
    if pixels.ndim != 2 or min(pixels.shape) < 2:
        raise InputError(
            f"picture has shape {pixels.shape}; pass values (rows, columns), e.g. stack.mean − the black level."
        )
    if wrong := int((~np.isfinite(pixels)).sum()):
        raise InputError(
            f"picture is NaN or infinite in {wrong} place(s); pass finite values, e.g. a part without them."
        )
    return pixels.astype(np.float64)


def flat_fielded(picture: Float64Array, flat: ArrayLike | None) -> Float64Array:
    """The picture over a flat field whose mean is made 1; raises InputError where that has another shape or is dark."""
    if flat is None:
        return picture
    light = picture_of(flat)
    if light.shape != picture.shape or not light.min() > 0:
        raise InputError(
            f"flat has shape {light.shape} and values from {light.min():g}; pass positive values of the picture's "
            f"shape {picture.shape}."
        )
    return np.asarray(picture * (light.mean() / light))
