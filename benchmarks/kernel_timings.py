"""Tasks that time parts of the compiled backend: the kernel alone, and the random numbers alone.

Both use data that Dr.Jit holds already, and wait for the result. They are None for a backend without kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from frame_sources import FRAMES_PER_TURN
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.core.signals import Photons
from mitsuba_sensor.sensor.chain import chain
from mitsuba_sensor.sensor.detection import detect, uploaded
from mitsuba_sensor.sensor.run import begin, choose_backend, row_strips_of
from mitsuba_sensor.sensor.stage import sample

EXPOSURE = ms.Exposure(0.1)


def kernel_only(engine: str, photons: NDArray[np.float64], camera: ms.Camera) -> Callable[[], object] | None:
    """One frame of this camera without the conversion from NumPy and to NumPy."""
    if engine != "drjit":
        return None
    backend: Any = choose_backend(engine, "float32", 0)
    whole, stages = Frame(EXPOSURE, SensorWindow(1, photons.shape, backend=backend)), chain(camera)
    parts = []
    for rows in row_strips_of(photons.shape, backend.strip_pixels):
        frame = Frame(EXPOSURE, whole.window.crop_rows(rows))
        light = detect(Photons(photons[rows]), stages[0], frame)
        parts.append((begin(stages, uploaded(light.signal, frame), frame), frame))

    def run() -> None:
        for start, frame in parts * FRAMES_PER_TURN:
            codes = backend.uint(sample(stages[1:], start, Frame(EXPOSURE, frame.window)))
            drjit().eval(codes)
        drjit().sync_thread()

    run.runs = FRAMES_PER_TURN  # type: ignore[attr-defined]
    return run


def random_numbers_only(engine: str, shape: tuple[int, int]) -> Callable[[], object] | None:
    """The random bits of one frame and four normal deviates from them, without a camera."""
    if engine != "drjit":
        return None
    backend: Any = choose_backend(engine, "float32", 0)
    window = SensorWindow(1, shape, backend=backend)
    parts = [window.crop_rows(rows) for rows in row_strips_of(shape, backend.strip_pixels)]

    def run() -> None:
        for part in parts * FRAMES_PER_TURN:
            one, two, three, four = (backend.normal(bits) for bits in backend.random_bits(0, part, 0, 1))
            drjit().eval(one + two + three + four)
        drjit().sync_thread()

    run.runs = FRAMES_PER_TURN  # type: ignore[attr-defined]
    return run
