"""Images as they come in, arrays and tensors: their light, and what is made of it as they were."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core import InputError, refuse_masked
from ..core.checks import PICTURE_FILE, refuse_path
from ..core.types import Float32Array
from ..optics.spectra import inverse_srgb_curve

Values: TypeAlias = Literal["electrons", "linear", "srgb"]
Image: TypeAlias = Any
"""A NumPy array, or a tensor of PyTorch, whose methods alone are used."""

EIGHT_BITS = 255
MOST_SRGB = 2.0
"""Filters overshoot, and screens of high range go beyond 1; numbers of 8 bits in floats are a mistake."""


def scaled(values: NDArray[Any], kind: Values, factor: np.float32) -> Float32Array:
    """Proportional to light, times a factor. Raises InputError for values that are not of this kind."""
    if kind == "linear" and values.dtype.kind in "iu":
        raise InputError(
            f"image is {values.dtype}, as a picture has it, and values 'linear', of which 1 is white; pass "
            'values="srgb" for a picture, or floats whose white is 1.'
        )
    if kind != "srgb":
        return np.asarray(
            np.multiply(values, factor, dtype=np.float32, casting="unsafe"), np.float32
        )
    if values.dtype == np.uint8:
        levels = inverse_srgb_curve(np.linspace(0, 1, EIGHT_BITS + 1, dtype=np.float32))
        return np.asarray(np.take(levels * factor, values), np.float32)
    if values.dtype.kind in "iu":
        raise InputError(
            f"image is {values.dtype} and values 'srgb'; pass uint8, or floats from 0 to 1."
        )
    if values.max(initial=0) > MOST_SRGB:
        raise InputError(
            f"image has values up to {values.max():g} and values 'srgb'; pass uint8, or floats from 0 to 1."
        )
    return np.asarray(inverse_srgb_curve(values.astype(np.float32)) * factor, np.float32)


def as_array(image: Image) -> NDArray[Any]:
    """Of an array or a tensor; booleans, text and complex numbers are refused."""
    if hasattr(image, "detach"):
        image = image.detach().cpu()
        image = (
            image.float() if image.is_floating_point() else image
        ).numpy()  # NumPy has no bfloat16
    refuse_masked("image", image)
    refuse_path("image", image, PICTURE_FILE)
    array = np.asarray(image)
    if array.dtype.kind not in "iuf":
        raise InputError(f"image is {array.dtype}; pass integers or floats.")
    return array


def as_given(found: NDArray[Any], given: Image) -> Image:
    """A tensor beside the one that came in, of floats, for its integers are few; else as it is."""
    if hasattr(given, "new_tensor"):
        return given.new_empty(0).float().new_tensor(found.astype(np.float32))
    return found
