"""Two timings inside the compiled engine: tasks for ``take_turns``, or None for an engine without kernels.

Both work on what is already on the device, and wait until it is done.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from engines import FRAMES_A_TURN
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Photons
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.run import begin, choose_backend, row_strips_of, run_chain

EXPOSURE = ms.Exposure(0.1)


def kernel_only(engine: str, photons: NDArray[np.float64], camera: ms.Camera) -> Callable[[], object] | None:
    """One frame of this camera without its way in from NumPy and out to NumPy."""
    if engine != "drjit":
        return None
    backend: Any = choose_backend(engine, "float32", 0)
    whole, stages = Frame(EXPOSURE, SensorWindow(1, photons.shape, backend=backend)), chain(camera)
    parts = []
    for rows in row_strips_of(photons.shape, backend.strip):
        frame = Frame(EXPOSURE, whole.window.rows_only(rows))
        parts.append((begin(stages, Photons(photons[rows]), frame), frame))

    def run() -> None:
        for start, frame in parts * FRAMES_A_TURN:
            codes = backend.uint(run_chain(stages[1:], start, Frame(EXPOSURE, frame.window)))
            drjit().eval(codes)
        drjit().sync_thread()

    run.runs = FRAMES_A_TURN  # type: ignore[attr-defined]
    return run


def generator_floor(engine: str, shape: tuple[int, int]) -> Callable[[], object] | None:
    """The random words of one frame and four normals of them, and no camera."""
    if engine != "drjit":
        return None
    backend: Any = choose_backend(engine, "float32", 0)
    window = SensorWindow(1, shape, backend=backend)
    parts = [window.rows_only(rows) for rows in row_strips_of(shape, backend.strip)]

    def run() -> None:
        for part in parts * FRAMES_A_TURN:
            one, two, three, four = (backend.normal(words) for words in backend.random_bits(0, part, 0, 1))
            drjit().eval(one + two + three + four)
        drjit().sync_thread()

    run.runs = FRAMES_A_TURN  # type: ignore[attr-defined]
    return run
