"""Type aliases: arrays that NumPy or Dr.Jit computes, NumPy arrays, random bits and the Dr.Jit module."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

# One value per pixel, (H, W), or one for all: a NumPy array (float64 or float32), a Dr.Jit array, or a number. Dr.Jit's
# array types depend on the backend and are made at run time, so no static type names them all.
Array: TypeAlias = Any
NumpyArray: TypeAlias = NDArray[Any]
Float32Array: TypeAlias = NDArray[np.float32]
Float64Array: TypeAlias = NDArray[np.float64]
RandomBits: TypeAlias = NDArray[np.uint32]
DrJitModule: TypeAlias = (
    Any  # its members depend on how it was built; it is imported late, without types that fit
)
