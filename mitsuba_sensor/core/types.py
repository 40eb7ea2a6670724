"""Types of the values that pass through the sensor: the one alias for arrays that NumPy or Dr.Jit computes."""

from __future__ import annotations

from typing import Any, TypeAlias

Array: TypeAlias = Any
"""One value per pixel, (H, W), or one for all: a NumPy array (float64 or float32), a Dr.Jit array, or a number.

Dr.Jit's array types depend on the back end and are made at run time, so no static type names them all.
"""
