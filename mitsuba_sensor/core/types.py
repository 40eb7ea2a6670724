"""Type aliases: arrays that NumPy or Dr.Jit computes, NumPy arrays, random bits and the Dr.Jit module."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = Any
"""One value per pixel, (H, W), or one for all: a NumPy array (float64 or float32), a Dr.Jit array, or a number.

Dr.Jit's array types depend on the backend and are made at run time, so no static type names them all.
"""

NumpyArray: TypeAlias = NDArray[Any]
"""A NumPy array of any type of number."""

Float32Array: TypeAlias = NDArray[np.float32]
Float64Array: TypeAlias = NDArray[np.float64]
RandomBits: TypeAlias = NDArray[np.uint32]

DrJitModule: TypeAlias = Any
"""The module ``drjit``, whose members depend on how it was built; it is imported late and ships no types that fit."""
