"""Images as they come in, arrays and tensors: their light, and what is made of it as they were."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core import InputError, refuse_masked
from ..core.checks import PICTURE_FILE, refuse_path
from ..core.types import Float32Array, NumpyArray
from ..optics.spectra import inverse_srgb_curve

Values: TypeAlias = Literal["electrons", "linear", "srgb"]
Image: TypeAlias = Any
"""A NumPy array, or a tensor of PyTorch, whose methods alone are used."""

EIGHT_BITS = 255
MOST_SRGB = 1.001
"""Up to rounding in half precision, a value behind the sRGB curve is 1 at most."""


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
    _check_srgb(values)
    return np.asarray(inverse_srgb_curve(values.astype(np.float32)) * factor, np.float32)


def _check_srgb(values: NumpyArray) -> None:
    """Raise InputError for values that are not behind the sRGB curve: integers of more than 8 bits, and numbers out of
    the range from 0 to 1."""
    if values.dtype.kind in "iu":
        highest = np.iinfo(values.dtype).max
        raise InputError(
            f"image is {values.dtype} with values up to {values.max(initial=0)}, and values 'srgb' takes uint8, or "
            f"floats from 0 to 1; divide by the code of white, e.g. image / {highest}."
        )
    if values.size and not 0 <= values.min() <= values.max() <= MOST_SRGB:
        raise InputError(
            f"image has values from {values.min():g} to {values.max():g}, and values 'srgb' takes floats from 0 to 1, "
            'or uint8; clip them, np.clip(image, 0, 1), or pass values="linear" for light that goes beyond white.'
        )


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


def as_came_in(developed: Float32Array, given: NumpyArray) -> NumpyArray:
    """A developed picture as integers of 8 bits where such came in, rounded and clipped; else as it is."""
    if given.dtype != np.uint8:
        return developed
    return np.clip(np.rint(developed * 255), 0, 255).astype(np.uint8)
