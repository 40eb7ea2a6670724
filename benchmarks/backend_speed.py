"""Measure the speed of the backends in Mpx/s, compared with a simple NumPy chain of the same stages.

    python benchmarks/backend_speed.py [--mpx 1 4 12] [--electrons 1 1000 30000] [--content flat ramp random]
        [--turns 5] [--engines numpy drjit numpy64] [--json]
        [--parts cases first]

cases : the next frame of an open stream of the full chain, for every size × level × content.
first : the first frame of a process, with and without compiled kernels on disk.

``first`` uses the median size and level, and a ramp; tests/sensor/test_backends.py counts what a change compiles.
Ratios are medians of the ratios of single turns; a ratio above 1 means that the backend is faster.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from cases import CONTENTS, EXPOSURE, full_chain, photon_map, shape_of
from numpy.typing import NDArray
from plain_chain import PlainChain
from timing import alternate, in_child, lines, speeds

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.core.versions import machine

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
    """Yield frames (H, W); the FPN maps are computed here."""
    if name == PLAIN:
        return PlainChain(photons, camera, exposure, seed)
    return ms.stream(
        photons, camera, exposure, seed=seed, serial=serial, frames=ENDLESS, **ENGINES[name]
    )


def next_frame(
    name: str, photons: NDArray[np.float64], camera: ms.Camera
) -> Callable[[], NDArray[Any]]:
    """Return a task for ``alternate``: the next frame of an open stream.

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


def refusal(name: str, camera: ms.Camera) -> str | None:
    """Return why this backend does not work on this machine, or None."""
    try:
        next(open_stream(name, np.ones((4, 4)), camera))
    except ms.InputError as error:
        return str(error)
    return None


def main() -> None:
    """Parse the options, run the parts, print the results."""
    options = parsed()
    refused = {name: why for name in options.engines if (why := refusal(name, full_chain()))}
    options.engines = [name for name in options.engines if name not in refused]
    parts = {name: PARTS[name](options) for name in options.parts}
    results = {**machine(), "turns": options.turns, "refused": refused, **parts}
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def parsed() -> argparse.Namespace:
    """Parse the command-line options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--mpx", type=float, nargs="+", default=[1, 4, 12], help="million pixels"
    )
    parser.add_argument(
        "--electrons",
        type=float,
        nargs="+",
        default=[1, 1000, 30000],
        help="mean photoelectrons",
    )
    parser.add_argument(
        "--content",
        nargs="+",
        default=list(CONTENTS),
        choices=CONTENTS,
        help="spatial distribution of the light",
    )
    parser.add_argument("--turns", type=int, default=5, help="measured turns (default 5)")
    parser.add_argument(
        "--engines", nargs="+", default=["numpy", "drjit", "numpy64"], choices=ENGINES
    )
    parser.add_argument(
        "--parts",
        nargs="+",
        default=list(PARTS),
        choices=PARTS,
        help="what to measure (default all)",
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def cases(options: argparse.Namespace) -> dict[str, Any]:
    """Return the speed for every size, level and content, and the smallest and median ratio of every backend."""
    rows = []
    for mpx, electrons, content in product(options.mpx, options.electrons, options.content):
        photons = photon_map(full_chain(), electrons, content, shape_of(mpx))
        tasks = {
            name: next_frame(name, photons, full_chain()) for name in (PLAIN, *options.engines)
        }
        found = speeds(alternate(tasks, options.turns), photons.size, PLAIN)
        rows.append({"mpx": mpx, "electrons": electrons, "content": content, "engines": found})
    ratios = {
        name: [row["engines"][name]["ratio_to_plain"] for row in rows]
        for name in options.engines
    }
    summary = {
        name: {"min_ratio": min(all_), "median_ratio": statistics.median(all_)}
        for name, all_ in ratios.items()
    }
    return {"rows": rows, "summary": summary}


def first(options: argparse.Namespace) -> dict[str, Any]:
    """Return times of first frames of new processes, without and with compiled kernels on disk."""
    mpx, electrons = middle(options.mpx), middle(options.electrons)
    found = {}
    for engine in options.engines:
        turns = []
        for _ in range(options.turns):
            with tempfile.TemporaryDirectory() as home:
                fresh, cached = (
                    in_child("backend_speed", "first_frame", engine, mpx, electrons, home=home)
                    for _ in "12"
                )
            turns.append((fresh, cached))
        found[engine] = {
            "fresh_first_s": statistics.median(fresh["first_s"] for fresh, _ in turns),
            "cached_first_s": statistics.median(cached["first_s"] for _, cached in turns),
            "compile_s": statistics.median(fresh["compile_s"] for fresh, _ in turns),
            "cached_compile_s": statistics.median(cached["compile_s"] for _, cached in turns),
            "steady_s": statistics.median(cached["steady_s"] for _, cached in turns),
        }
    return found


def first_frame(engine: str, mpx: float, electrons: float) -> dict[str, float]:
    """Return the seconds of the first frame, of its compilation, and the median of three later frames.

    The compilation time is Dr.Jit's own record: writing, compiling or reading kernels.
    """
    photons = photon_map(full_chain(), electrons, "ramp", shape_of(mpx))
    kernels: list[dict[str, Any]] = []
    if engine in ("drjit", "cuda"):
        drjit().set_flag(drjit().JitFlag.KernelHistory, True)
    start = time.perf_counter()
    frame = next_frame(engine, photons, full_chain())
    frame()
    first_s = time.perf_counter() - start
    if engine in ("drjit", "cuda"):
        kernels = drjit().kernel_history([drjit().KernelType.JIT])
    compile_s = 1e-3 * sum(one["codegen_time"] + one["backend_time"] for one in kernels)
    steady_s = statistics.median(alternate({"": frame}, 3)[""])
    return {"first_s": first_s, "compile_s": compile_s, "steady_s": steady_s}


def middle(values: list[float]) -> float:
    """Return the median, or the smaller of the two middle values."""
    return statistics.median_low(values)


PARTS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "cases": cases,
    "first": first,
}

if __name__ == "__main__":
    main()
