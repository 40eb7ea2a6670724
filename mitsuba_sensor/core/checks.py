"""Checks of arguments that both rendering and the sensor use."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError, require_seed, shown
from .exposure import Exposure
from .types import Float64Array, NumpyArray

LIGHT_FILE = "read the file first, e.g. ms.read_irradiance(path)"
PICTURE_FILE = "read the picture first, e.g. np.asarray(PIL.Image.open(path))"
OTHER_KINDS = {"b": "a Boolean array, e.g. a mask", "c": "complex"}
"""Kind of a NumPy dtype that does not hold real numbers → description."""
PEAK_MIN, PEAK_MAX = 1e-30, 1e30
"""Allowed range of the largest value of an array: its fourth power is neither 0 nor infinite."""


def check_types(camera: object, exposure: object, optional: bool = False) -> None:
    """Raise InputError unless ``camera`` is a Camera and ``exposure`` an Exposure.  optional : both may be None."""
    if not hasattr(camera, "quantum_efficiency") and not (optional and camera is None):
        raise InputError(
            f"camera is {shown(camera)}; pass a Camera or the name of a camera, e.g. 'konnik_table1'."
        )
    if isinstance(exposure, Exposure) or (optional and exposure is None):
        return
    example = "e.g. Exposure(time_s=0.1)"
    if isinstance(exposure, int | float) and not isinstance(exposure, bool):
        raise InputError(
            f"exposure is the number {exposure!r}; for {exposure!r} s, pass Exposure(time_s={exposure!r})."
        )
    if (isinstance(exposure, str) and exposure == "auto") or hasattr(exposure, "unit_exposure"):
        raise InputError(
            f"exposure is {shown(exposure)}, but only rendered light (an Irradiance) can be metered, by capture, "
            f"expose or stream; pass an Exposure, {example}."
        )
    raise InputError(
        f'exposure is {shown(exposure)}; pass an Exposure, {example}, or "auto" for rendered light.'
    )


def refuse_masked(name: str, values: object) -> None:
    """Raise InputError for an array of numpy.ma with masked values; NumPy would ignore the mask."""
    arrays = values if isinstance(values, list | tuple) else (values,)
    masks = [getattr(array, "mask", None) for array in arrays]
    masked = sum(int(np.sum(mask)) for mask in masks if isinstance(mask, np.ndarray | np.bool_))
    if masked:
        raise InputError(
            f"{name} has {masked} masked value(s); fill them, e.g. {name}.filled(0.0), or omit those pixels."
        )


def refuse_path(name: str, values: object, remedy: str) -> None:
    """Raise InputError for a file name instead of an array.  remedy : how to read the file."""
    has_suffix = isinstance(values, str) and os.path.splitext(values)[1][1:2].isalpha()
    if has_suffix or isinstance(values, os.PathLike):
        raise InputError(f"{name} is the file name {str(values)[:200]!r}; {remedy}.")


def numeric_array(name: str, values: object, remedy: str) -> NumpyArray:
    """Return ``values`` as an array of integers or floats.  remedy : what to pass.

    Raises InputError for text, booleans, complex numbers, ragged lists, masked values and None.
    """
    refuse_masked(name, values)
    refuse_path(name, values, f"{LIGHT_FILE}; pass {remedy}")
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(f"{name} has rows of different lengths; pass {remedy}.") from None
    if array.dtype.kind not in "iuf":
        kind = OTHER_KINDS.get(array.dtype.kind, "not numeric")
        raise InputError(f"{name} is {kind}; pass {remedy}.")
    return array


def numbers(name: str, values: object, remedy: str) -> Float64Array:
    """Return ``values`` as float64, checked by :func:`numeric_array`.  remedy : what to pass."""
    return np.asarray(numeric_array(name, values, remedy), dtype=np.float64)


def finite_numbers(name: str, values: object, remedy: str) -> Float64Array:
    """Return ``values`` as float64, checked by :func:`numbers` and :func:`require_finite`.  remedy : what to pass."""
    array = numbers(name, values, remedy)
    require_finite(name, array, remedy)
    return array


def require_finite(name: str, array: NumpyArray, remedy: str) -> None:
    """Raise InputError if an array holds NaN or infinity, or if its peak is below 1e-30 or above 1e30."""
    if wrong := array.size - int(np.count_nonzero(np.isfinite(array))):
        raise InputError(
            f"{name} has {wrong} value(s) that are NaN or infinite; pass finite {remedy}."
        )
    largest = max(float(array.max(initial=0.0)), -float(array.min(initial=0.0)))
    if largest and not PEAK_MIN <= largest <= PEAK_MAX:
        raise InputError(
            f"{name} has values up to {largest:.3g}; pass {remedy}, in a unit in which the largest value is from "
            f"{PEAK_MIN:g} to {PEAK_MAX:g}."
        )


def require_path(name: str, path: object, example: str) -> Path:
    """Return a text or path as a Path; else raise InputError.  example : a path to pass."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{name} is {shown(path)}; pass a path, e.g. {example!r}.")
    return Path(path)


def require_pair(name: str, pair: object, what: str) -> tuple[int, int]:
    """Return two whole numbers, rows and columns; else raise InputError.  what : their meaning, with an example."""
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(f"{name} is {shown(pair)}; it must be {what}.")
    return require_seed(name, pair[0]), require_seed(name, pair[1])


def require_frame(number: Any, count: int) -> int:
    """Return the number of a frame, from 0, or from -1 for the last frame backwards; else raise InputError."""
    is_whole = isinstance(number, int | np.integer) and not isinstance(number, bool)
    if not is_whole or not -count <= int(number) < count:
        raise InputError(
            f"number is {shown(number)}; it must be from 0 to {count - 1}, or -1 for the last frame."
        )
    return int(number)


def first_given(*values: Any) -> Any:
    """Return the first value that is not None, or None."""
    return next((value for value in values if value is not None), None)
