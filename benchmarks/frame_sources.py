"""Open endless streams of frames from each backend and from the simple NumPy chain, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from cases import EXPOSURE, full_chain
from numpy.typing import NDArray
from plain_chain import PlainChain

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit

ENGINES: dict[str, dict[str, Any]] = {
    "numpy": {"engine": "numpy", "precision": "float32"},
    "drjit": {"engine": "drjit", "precision": "float32"},
    "numpy64": {"engine": "numpy", "precision": "float64"},
    "cuda": {"engine": "cuda", "precision": "float32"},
}
"""Name in the benchmarks → backend and precision of ``ms.stream``."""

PLAIN = "plain"
"""Name of the simple chain of ``plain_chain.py``."""

FRAMES_PER_TURN = 8
"""Frames of a compiled backend per turn; times are divided by it. They take half the time of one plain frame."""

ENDLESS = 2**31
"""More frames than any benchmark uses."""


def open_stream(
    name: str,
    photons: NDArray[np.float64],
    camera: ms.Camera,
    exposure: ms.Exposure = EXPOSURE,
    *,
    seed: int = 1,
    serial: int = 1,
) -> Iterator[NDArray[Any]]:
    """Frames (H, W), one per ``next()``. FPN maps are computed here."""
    if name == PLAIN:
        return PlainChain(photons, camera, exposure, seed)
    return ms.stream(
        photons, camera, exposure, seed=seed, serial=serial, frames=ENDLESS, **ENGINES[name]
    )


def next_frame(
    name: str, photons: NDArray[np.float64], camera: ms.Camera
) -> Callable[[], NDArray[Any]]:
    """A task for ``alternate``: the next frame of an open stream.

    A compiled backend computes several frames per turn, as in a stream, where one frame is computed while the next is
    traced. At the end of the turn the task waits for the frame that has begun, so that turns do not overlap.
    """
    frames = open_stream(name, photons, camera)
    if name not in ("drjit", "cuda"):
        return partial(next, frames)

    def task() -> NDArray[Any]:
        *_, frame = (next(frames) for _ in range(FRAMES_PER_TURN))
        drjit().sync_thread()
        return frame

    task.runs = FRAMES_PER_TURN  # type: ignore[attr-defined]
    return task


def next_exposure(
    name: str, maps: Sequence[NDArray[np.float64]], with_sensor: bool
) -> Callable[[], NDArray[Any]]:
    """A task for ``alternate``: frames of these photon maps, one after the other, each by one call.

    with_sensor : of one ``ms.Sensor``; otherwise of ``ms.expose``.
    """
    camera = full_chain()
    sensor = ms.Sensor(camera, serial=1)
    options = ENGINES[name]

    def task() -> NDArray[Any]:
        for photons in maps:
            if with_sensor:
                frames = sensor.expose(photons, EXPOSURE, **options)
            else:
                frames = ms.expose(photons, camera, EXPOSURE, serial=1, **options)
        return frames.digital

    task.runs = len(maps)  # type: ignore[attr-defined]
    return task


def refusal(name: str, camera: ms.Camera) -> str | None:
    """Why this backend does not work on this machine, or None if it does."""
    try:
        next(open_stream(name, np.ones((4, 4)), camera))
    except ms.InputError as error:
        return str(error)
    return None
