"""Everything that makes frames, by the name it has in the benchmarks, as an endless iterator that is kept open."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from cases import EXPOSURE
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
"""Benchmark name → engine and precision of ``ms.stream``."""

PLAIN = "plain"
"""The yardstick of ``plain_chain.py``."""

FRAMES_A_TURN = 8
"""Frames of a compiled engine per turn, about half of the time that the plain chain takes for one; divided out."""

ENDLESS = 2**31
"""More frames than any benchmark takes."""


def open_stream(
    name: str,
    photons: NDArray[np.float64],
    camera: ms.Camera,
    exposure: ms.Exposure = EXPOSURE,
    *,
    seed: int = 1,
    serial: int = 1,
) -> Iterator[NDArray[Any]]:
    """Frames (H, W), one per ``next()``; light and fixed maps are made here."""
    if name == PLAIN:
        return PlainChain(photons, camera, exposure, seed)
    return ms.stream(photons, camera, exposure, seed=seed, serial=serial, frames=ENDLESS, **ENGINES[name])


def next_frame(name: str, photons: NDArray[np.float64], camera: ms.Camera) -> Callable[[], NDArray[Any]]:
    """A task for ``take_turns``: the next frame of a stream that stays open.

    A compiled engine takes several frames a turn, as a stream does: while one is computed the next is traced. The one
    that it has begun at the end is waited for: nobody works in another's turn.
    """
    frames = open_stream(name, photons, camera)
    if name not in ("drjit", "cuda"):
        return partial(next, frames)

    def task() -> NDArray[Any]:
        *_, frame = (next(frames) for _ in range(FRAMES_A_TURN))
        drjit().sync_thread()
        return frame

    task.runs = FRAMES_A_TURN  # type: ignore[attr-defined]
    return task


def refusal(name: str, camera: ms.Camera) -> str | None:
    """Why this engine makes no frames on this machine, or None where it does."""
    try:
        next(open_stream(name, np.ones((4, 4)), camera))
    except ms.InputError as error:
        return str(error)
    return None
