"""Checks of the arguments of public functions that both rendering and the sensor use."""

import os
from pathlib import Path
from typing import TypeVar, cast, overload

import numpy as np

from .errors import InputError, require_seed, shown
from .exposure import Exposure
from .types import Float64Array, NumpyArray

Value = TypeVar("Value")
LIGHT_FILE = "read the file first, an irradiance.exr by ms.read_irradiance"
PICTURE_FILE = "read the picture first, e.g. np.asarray(PIL.Image.open(path))"
OTHER_KINDS = {"b": "of bool, as a mask or a picture has it", "c": "complex"}
"""What arrays are that are no arrays of real numbers, by NumPy's kind of dtype."""
SMALLEST, LARGEST = 1e-30, 1e30
"""Of the largest value of measured numbers: squares of their squares are neither 0 nor infinite."""


def check_types(camera: object, exposure: object, optional: bool = False) -> None:
    """Raise InputError unless ``camera`` is a Camera and ``exposure`` an Exposure.  optional : either may be None."""
    if not hasattr(camera, "quantum_efficiency") and not (optional and camera is None):
        raise InputError(
            f"camera is {camera!r}; pass a Camera, or the name of one, e.g. 'konnik_table1'."
        )
    if not isinstance(exposure, Exposure) and not (optional and exposure is None):
        raise InputError(_exposure_sentence(exposure))


def _exposure_sentence(exposure: object) -> str:
    """What to pass in place of this exposure."""
    is_number = isinstance(exposure, int | float) and not isinstance(exposure, bool)
    if is_number:
        return (
            f"exposure is the number {exposure!r}; for an exposure time of {exposure!r} s pass "
            f"Exposure(time_s={exposure!r})."
        )
    example = "pass an Exposure, e.g. Exposure(time_s=0.1)"
    is_auto = isinstance(exposure, str) and exposure == "auto"
    if is_auto or hasattr(exposure, "unit_exposure"):
        return (
            f"exposure is {exposure!r}, and only rendered light (an Irradiance) is metered, by capture, expose and "
            f"stream; {example}."
        )
    return (
        f'exposure is {exposure!r}; {example}, or "auto" where rendered light is to be metered.'
    )


def refuse_masked(name: str, values: object) -> None:
    """Raise InputError for an array of numpy.ma in which any value is masked; NumPy would go on without the mask."""
    if isinstance(values, list | tuple):
        parts = values
    else:
        parts = (values,)
    masks = [getattr(part, "mask", None) for part in parts]
    masked = sum(int(np.sum(mask)) for mask in masks if isinstance(mask, np.ndarray | np.bool_))
    if masked:
        raise InputError(
            f"{name} has {masked} masked value(s), of which nothing is known; pass numbers instead, e.g. "
            f"{name}.filled(0.0), or leave those pixels out."
        )


def refuse_path(name: str, values: object, remedy: str) -> None:
    """Raise InputError for the name of a file in place of an array.  remedy : how the file is read."""
    is_path = isinstance(values, os.PathLike)
    if isinstance(values, str):
        is_path = os.path.splitext(values)[1][1:2].isalpha()
    if is_path:
        raise InputError(f"{name} is the name of a file, {str(values)[:200]!r}; {remedy}.")


def numbers(name: str, values: object, remedy: str) -> Float64Array:
    """``values`` as float64; InputError for text, booleans, complex numbers, ragged lists, masked values and None.

    remedy : what to pass.
    """
    refuse_masked(name, values)
    refuse_path(name, values, f"{LIGHT_FILE}; pass {remedy}")
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(
            f"{name} is ragged, its rows have different lengths; pass {remedy}."
        ) from None
    if array.dtype.kind not in "iuf":
        kind = OTHER_KINDS.get(array.dtype.kind, "not numeric")
        raise InputError(f"{name} is {kind}; pass {remedy}.")
    return np.asarray(array, dtype=np.float64)


def finite_numbers(name: str, values: object, remedy: str) -> Float64Array:
    """``values`` as float64, as :func:`numbers` and :func:`require_finite` have them.  remedy : what to pass."""
    array = numbers(name, values, remedy)
    require_finite(name, array, remedy)
    return array


def require_finite(name: str, array: NumpyArray, remedy: str) -> None:
    """Raise InputError for NaN and infinity in an array, and where all of it is too small or any too large."""
    if wrong := array.size - int(np.count_nonzero(np.isfinite(array))):
        raise InputError(
            f"{name} is NaN or infinite in {wrong} place(s); pass finite {remedy}."
        )
    largest = max(float(array.max(initial=0.0)), -float(array.min(initial=0.0)))
    if largest and not SMALLEST <= largest <= LARGEST:
        raise InputError(
            f"{name} has values up to {largest:.3g}; pass {remedy}, in a unit in which the largest is from "
            f"{SMALLEST:g} to {LARGEST:g}."
        )


def require_path(name: str, path: object, example: str) -> Path:
    """A path, as text or path. Raises InputError for anything else.  example : of what to pass."""
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"{name} is {shown(path)}; pass a path, e.g. {example!r}.")
    return Path(path)


def require_pair(name: str, pair: object, what: str) -> tuple[int, int]:
    """Two whole numbers of rows and columns. Raises InputError.  what : they are, with an example."""
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise InputError(f"{name} is {shown(pair)}; it must be {what}.")
    return require_seed(name, pair[0]), require_seed(name, pair[1])


def require_frame(number: object, count: int) -> int:
    """The number of one of the frames, from 0, or from the end. Raises InputError."""
    whole = isinstance(number, int | np.integer) and not isinstance(number, bool)
    if not whole or not -count <= int(cast(int, number)) < count:
        raise InputError(
            f"number is {shown(number)}; the frames are numbered from 0 to {count - 1}."
        )
    return int(cast(int, number))


@overload
def first_given(value: Value | None, default: Value, /) -> Value: ...
@overload
def first_given(value: Value | None, other: Value | None, default: Value, /) -> Value: ...
@overload
def first_given(*values: Value | None) -> Value | None: ...
def first_given(*values: Value | None) -> Value | None:
    """The first value that is not None; None if all are."""
    return next((value for value in values if value is not None), None)
