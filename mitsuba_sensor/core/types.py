"""Type aliases for NumPy and Dr.Jit arrays, random bits and the Dr.Jit module."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

# One value per pixel, (H, W), or one for all: a NumPy array (float64 or float32), a Dr.Jit array, or a number. Dr.Jit
# creates its array types at run time, so no static type covers them.
Array: TypeAlias = Any
NumpyArray: TypeAlias = NDArray[Any]
Float32Array: TypeAlias = NDArray[np.float32]
Float64Array: TypeAlias = NDArray[np.float64]
RandomBits: TypeAlias = NDArray[np.uint32]
DrJitModule: TypeAlias = Any  # its members depend on its build, and it is imported late
