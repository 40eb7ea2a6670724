"""Nanoseconds per pixel of the sensor with one stage off at a time, all chains taking turns."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ...core.frame import Frame
from ...core.llvm import drjit
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...sensor.run import Run, choose_backend, run_chain
from ..sensor.frames import filled
from ..timing import one_turn
from .stages import Ablation

SHAPE = {"numpy": (256, 512), "drjit": (1024, 1024)}
"""Pixels of the frames that are timed, however small the render: one strip of NumPy's, and enough for a kernel."""

TURNS = {"numpy": 15, "drjit": 7}
"""In each of which every chain makes frames."""

FRAMES_A_TURN = 8
"""Of a compiled engine, which traces a frame while it computes the one before: several show what a stream costs."""

DETECTION = "detection"
"""What is timed apart: of light that stays, a compiled engine does it once, NumPy in every frame."""


def seconds_key(engine: str) -> str:
    """Under which the seconds of an engine are kept."""
    return f"sensor: seconds, {engine}"


def nanoseconds(ablation: Ablation, engine: str, cases: list[str]) -> dict[str, list[float]]:
    """Per pixel of each chain behind the detection, turn by turn; on NumPy also of the detection.

    engine : "numpy" or "drjit".  Nothing for a compiled engine where the plan asks for float64, which it has not.
    """
    if engine != "numpy" and ablation.plan.precision != "float32":
        return {}
    tasks = _on_numpy(ablation, cases) if engine == "numpy" else _compiled(ablation, engine, cases)
    pixels = SHAPE[engine][0] * SHAPE[engine][1]
    found: dict[str, list[float]] = {name: [] for name in tasks}
    for turn in range(TURNS[engine] + 1):
        order = list(tasks)[:: -1 if turn % 2 else 1]
        spent = one_turn({name: tasks[name] for name in order})
        for name, seconds in spent.items() if turn else ():  # the first turn makes maps and kernels
            found[name].append(1e9 * seconds / pixels)
    return found


def _on_numpy(ablation: Ablation, cases: list[str]) -> dict[str, Callable[[], int]]:
    shape = SHAPE["numpy"]
    window = SensorWindow(1, shape, backend=ablation.backend)
    frame = partial(Frame, ablation.exposure, window)
    detection, photons = ablation.plan.whole[0], filled(ablation.photons, shape)
    electrons = detection(photons, frame())

    def once(stages: tuple[Any, ...], start: Any) -> int:
        run_chain(stages, start, frame())
        return 1

    tasks = {case: partial(once, ablation.cases[case][1:], electrons) for case in cases}
    return {**tasks, DETECTION: partial(once, (detection,), photons)}


def _compiled(ablation: Ablation, engine: str, cases: list[str]) -> dict[str, Callable[[], int]]:
    shape, backend = SHAPE[engine], choose_backend(engine, "float32", 0)
    light = _few_layers(ablation, shape)

    def stream(stages: tuple[Any, ...]) -> Iterator[Any]:
        first, codes = (
            Frame(ablation.exposure, SensorWindow(1, shape, backend=backend)),
            np.min_scalar_type(stages[-1].highest),
        )
        return Run(stages, light, first).frames(0, 2**31, lambda _: {"digital": np.empty(shape, codes)})

    def some(frames: Iterator[Any]) -> int:
        for _ in range(FRAMES_A_TURN):
            next(frames)
        drjit().sync_thread()  # what a kernel has begun is waited for: nobody works in another's turn
        return FRAMES_A_TURN

    return {case: partial(some, stream(ablation.cases[case])) for case in cases}


def _few_layers(ablation: Ablation, shape: tuple[int, int]) -> Photons:
    """The scene's electrons on a window of another size, the same behind every filter: a cube would fill memory."""
    filters = len(ablation.camera.filter_names)
    light = ablation.plan.whole[0](ablation.photons, Frame(ablation.exposure, SensorWindow(1, ablation.shape))).light
    mean = filled(Photons(np.asarray(light)), shape).mean
    return Photons(np.repeat(mean[..., None], filters, axis=2), detected=True)
