"""The engines that tests compare."""

from __future__ import annotations

import pytest

from helpers.marks import exhaustive
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.sensor.run import choose_backend

ENGINES = ("float64", exhaustive("numpy"), exhaustive("drjit"))
"""The quick tests have a camera with every effect, whose float32 bytes are the same on NumPy and Dr.Jit."""


def backend_of(name: str) -> Backend:
    """float64, numpy (float32) or drjit; a skip where this machine has no LLVM."""
    if name == "drjit" and (problem := backend_problem("llvm")):
        pytest.skip(problem)
    known = {"float64": NUMPY_FLOAT64, "numpy": NUMPY_FLOAT32}
    return known.get(name) or choose_backend(name, "float32", 0)
