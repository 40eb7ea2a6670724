"""How fast do frames of one photon map stream, and how much memory does that take? Linux only: it reads /proc.

    python benchmarks/streaming.py [--shape 1300 1900] [--frames 64] [--peak-mpx 12] [--electrons 1000] [--runs 3]
        [--engines plain numpy drjit] [--json]

stream  frames/s into a buffer that is there before (kept), and of frames that are dropped; the first frame, which makes
        fixed maps, counts in one of the two numbers; resident memory after every eighth of the frames
peak    the most memory that three frames took beyond the photon map and one frame

Every run is a process of its own, and the engines take turns. Each process first makes a 16 × 16 frame of the same
camera: what is imported, Dr.Jit's start and the compilation of kernels are in the baseline, and not in these numbers.
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
from engines import ENGINES, PLAIN, open_stream
from turns import in_child, lines

from mitsuba_sensor.io.metadata import machine

LIMITS_MIB = {"drjit": 300, "numpy": 150}
"""Peak memory at 12 Mpx that we promise [MiB]."""

FLAT_MIB = 40
"""How much the resident memory may move while frames stream [MiB]."""

READINGS = 8
"""How many times the resident memory is read in a stream."""


def main() -> None:
    """Parse the options, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shape", type=int, nargs=2, default=[1300, 1900], help="rows and columns of a frame")
    parser.add_argument("--frames", type=int, default=64, help="frames of a stream, 8 or more (default 64)")
    parser.add_argument("--peak-mpx", type=float, default=12, help="million pixels for the peak memory (default 12)")
    parser.add_argument("--electrons", type=float, default=1000, help="mean electrons of light (default 1000)")
    parser.add_argument("--runs", type=int, default=3, help="processes of each kind (default 3)")
    parser.add_argument("--engines", nargs="+", default=[PLAIN, "numpy", "drjit"], choices=[PLAIN, *ENGINES])
    parser.add_argument("--json", action="store_true", help="only JSON")
    options = parser.parse_args()
    if options.frames < READINGS:
        parser.error(f"--frames is {options.frames}; memory is read {READINGS} times, so ask for at least {READINGS}.")
    if not Path("/proc/self/clear_refs").exists():
        raise SystemExit("Resident memory is read from /proc, so this benchmark needs Linux.")
    results = {**machine(), "runs": options.runs, "stream": streams(options), "peak": peaks(options)}
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def streams(options: argparse.Namespace) -> dict[str, Any]:
    """Medians of every engine, with frames kept and dropped."""
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
    """Median speeds, and the run whose memory moved most."""
    worst = max(runs, key=lambda run: run["resident_spread_mib"])
    return {
        "frames_per_s": statistics.median(run["frames_per_s"] for run in runs),
        "steady_frames_per_s": statistics.median(run["steady_frames_per_s"] for run in runs),
        "resident_spread_mib": worst["resident_spread_mib"],
        "flat": worst["resident_spread_mib"] <= FLAT_MIB,
        "resident_mib": " ".join(f"{mib:.0f}" for mib in worst["resident_mib"]),
    }


def stream(engine: str, shape: list[int], electrons: float, frames: int, keep: bool) -> dict[str, Any]:
    """In a child: one stream, and the resident memory after every eighth of it."""
    camera = full_chain()
    next(open_stream(engine, np.ones((16, 16)), camera))
    photons = photon_map(camera, electrons, "ramp", (shape[0], shape[1]))
    kept = np.ones((frames if keep else 1, *photons.shape), np.uint16)  # ones: the memory is there before the start
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
    """The largest peak of every engine."""
    arguments = options.peak_mpx, options.electrons
    runs: dict[str, list[float]] = {name: [] for name in options.engines}
    for _, name in product(range(options.runs), options.engines):
        runs[name].append(in_child("streaming", "peak_mib", name, *arguments))
    return {name: {"peak_mib": max(mib), "limit_mib": LIMITS_MIB.get(name)} for name, mib in runs.items()}


def peak_mib(engine: str, mpx: float, electrons: float) -> float:
    """In a child: the most memory that three frames took beyond the photon map and one frame."""
    camera = full_chain()
    next(open_stream(engine, np.ones((16, 16)), camera))
    photons = photon_map(camera, electrons, "ramp", shape_of(mpx))
    before = memory_mib("VmRSS")
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the kernel's peak of this process starts anew
    source = open_stream(engine, photons, camera)
    for _ in range(3):
        frame_mib = next(source).nbytes / 2**20  # and dropped: of what is delivered, one frame is there at a time
    return memory_mib("VmHWM") - before - frame_mib


def memory_mib(field: str) -> float:
    """VmRSS (resident now) or VmHWM (its peak) of this process."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith(field)).split()[1]) / 1024


if __name__ == "__main__":
    main()
