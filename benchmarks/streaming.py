"""Measure speed and memory of a stream of frames from one photon map (Linux only: it reads /proc).

    python benchmarks/streaming.py [--shape 1300 1900] [--frames 64] [--peak-mpx 12] [--electrons 1000] [--runs 3]
        [--engines plain numpy drjit] [--json]

stream  frames/s with all frames kept in an allocated buffer (kept), and with frames that are not kept (dropped), each
        with and without the first frame, which computes the FPN maps; resident memory after every eighth of the frames
peak    the peak memory of three frames, in addition to the photon map and one frame

Every run is a separate process, and the backends run alternately. Each process first computes a 16 × 16 frame of the
same camera, so that imports, the start of Dr.Jit and the compilation of kernels are not included.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from cases import full_chain, photon_map, shape_of
from frame_sources import ENGINES, PLAIN, open_stream
from timing import in_child, lines

from mitsuba_sensor.core.versions import machine

LIMITS_MIB = {"drjit": 300, "numpy": 150}
"""Limit of the peak memory at 12 Mpx [MiB]."""

FLAT_MIB = 40
"""Limit of the change of resident memory during a stream [MiB]."""

READINGS = 8
"""Number of readings of the resident memory during a stream."""


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", type=int, nargs=2, default=[1300, 1900], help="rows and columns of a frame")
    parser.add_argument("--frames", type=int, default=64, help="frames of a stream, 8 or more (default 64)")
    parser.add_argument("--peak-mpx", type=float, default=12, help="million pixels for the peak memory (default 12)")
    parser.add_argument("--electrons", type=float, default=1000, help="mean photoelectrons (default 1000)")
    parser.add_argument("--runs", type=int, default=3, help="processes of each kind (default 3)")
    parser.add_argument("--engines", nargs="+", default=[PLAIN, "numpy", "drjit"], choices=[PLAIN, *ENGINES])
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.frames < READINGS:
        parser.error(f"--frames is {options.frames}; it must be at least {READINGS}, the number of readings.")
    if not Path("/proc/self/clear_refs").exists():
        raise SystemExit("Resident memory is read from /proc, so this benchmark needs Linux.")
    results = {**machine(), "runs": options.runs, "stream": streams(options), "peak": peaks(options)}
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def streams(options: argparse.Namespace) -> dict[str, Any]:
    """Medians of every backend, with frames kept and dropped."""
    kinds = list(product(options.engines, (True, False)))
    runs: dict[tuple[str, bool], list[dict[str, Any]]] = {kind: [] for kind in kinds}
    for _, (engine, keep) in product(range(options.runs), kinds):
        arguments = engine, options.shape, options.electrons, options.frames, keep
        runs[engine, keep].append(in_child("streaming", "stream", *arguments))
    return {
        engine: {"kept" if keep else "dropped": digest(runs[engine, keep]) for keep in (True, False)}
        for engine in options.engines
    }


def digest(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Median speeds, and the run with the largest change of memory."""
    worst = max(runs, key=lambda run: run["resident_spread_mib"])
    return {
        "frames_per_s": statistics.median(run["frames_per_s"] for run in runs),
        "steady_frames_per_s": statistics.median(run["steady_frames_per_s"] for run in runs),
        "resident_spread_mib": worst["resident_spread_mib"],
        "flat": worst["resident_spread_mib"] <= FLAT_MIB,
        "resident_mib": " ".join(f"{mib:.0f}" for mib in worst["resident_mib"]),
    }


def stream(engine: str, shape: list[int], electrons: float, frames: int, keep: bool) -> dict[str, Any]:
    """In a child process: one stream, and the resident memory after every eighth of it."""
    camera = full_chain()
    next(open_stream(engine, np.ones((16, 16)), camera))
    photons = photon_map(camera, electrons, "ramp", (shape[0], shape[1]))
    kept = np.ones((frames if keep else 1, *photons.shape), np.uint16)  # ones: allocated before the start
    resident, moments = [], [time.perf_counter()]
    source = open_stream(engine, photons, camera)
    for index in range(frames):
        kept[index if keep else 0] = next(source)
        moments.append(time.perf_counter())
        if (index + 1) % (frames // READINGS) == 0:
            resident.append(memory_mib("VmRSS"))
    return {
        "frames_per_s": frames / (moments[-1] - moments[0]),
        "steady_frames_per_s": (frames - 1) / (moments[-1] - moments[1]),
        "resident_mib": resident,
        "resident_spread_mib": max(resident) - min(resident),
    }


def peaks(options: argparse.Namespace) -> dict[str, Any]:
    """The largest peak memory of every backend."""
    arguments = options.peak_mpx, options.electrons
    runs: dict[str, list[float]] = {name: [] for name in options.engines}
    for _, name in product(range(options.runs), options.engines):
        runs[name].append(in_child("streaming", "peak_mib", name, *arguments))
    return {name: {"peak_mib": max(mib), "limit_mib": LIMITS_MIB.get(name)} for name, mib in runs.items()}


def peak_mib(engine: str, mpx: float, electrons: float) -> float:
    """In a child process: the peak memory of three frames, in addition to the photon map and one frame [MiB]."""
    camera = full_chain()
    next(open_stream(engine, np.ones((16, 16)), camera))
    photons = photon_map(camera, electrons, "ramp", shape_of(mpx))
    before = memory_mib("VmRSS")
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets VmHWM of this process
    source = open_stream(engine, photons, camera)
    for _ in range(3):
        frame_mib = next(source).nbytes / 2**20  # not kept: only one frame exists at a time
    return memory_mib("VmHWM") - before - frame_mib


def memory_mib(field: str) -> float:
    """VmRSS (resident memory) or VmHWM (its peak) of this process [MiB]."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith(field)).split()[1]) / 1024


if __name__ == "__main__":
    main()
