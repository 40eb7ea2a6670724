"""Measure the peak memory of the first command with all 1920 × 1200 pixels of its colour camera, as whole processes.

    python benchmarks/render_memory.py            # three renders of 16 samples per pixel, a few minutes
    python benchmarks/render_memory.py --quick    # only checks that the script runs

Peak memory is ru_maxrss of the child process: render, frame and files together.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "first_frame.xml"
CASES = {
    "bands, denoised": ("--denoise",),
    "bands, not denoised": ("--no-denoise",),
    "only what the filters detect": ("--spectral", "channels", "--no-irradiance"),
}


class Measured(NamedTuple):
    """Peak memory and wall time of one process, and the size of what it wrote."""

    peak_mib: float
    seconds: float
    written_mib: float


def measure(columns: int, rows: int, spp: int, options: tuple[str, ...]) -> Measured:
    """One whole process."""
    with tempfile.TemporaryDirectory() as folder:
        size = ("-D", f"width={columns}", "-D", f"height={rows}", "--spp", str(spp))
        arguments = ("render", str(SCENE), "-o", folder, *size, *options)
        start = time.perf_counter()
        child = subprocess.Popen(
            [sys.executable, "-m", "mitsuba_sensor", *arguments], stdout=subprocess.DEVNULL
        )
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            sys.exit(f"{' '.join(arguments)}: exit code {child.returncode}")
        written = sum(path.stat().st_size for path in Path(folder).iterdir())
    return Measured(usage.ru_maxrss / 1024, seconds, written / 2**20)


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument(
        "--quick",
        action="store_true",
        help="one render of 48 × 32 pixels: a check of the script",
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    columns, rows = (48, 32) if options.quick else (1920, 1200)
    cases = list(CASES.items())[: 1 if options.quick else None]
    found = {name: measure(columns, rows, options.spp, more) for name, more in cases}
    if options.json:
        print(json.dumps({name: one._asdict() for name, one in found.items()}))
        return
    print(f"{columns} × {rows}, {options.spp} samples")
    for name, one in found.items():
        print(
            f"{name:30} peak {one.peak_mib:5.0f} MiB   {one.seconds:5.0f} s   files {one.written_mib:4.0f} MiB"
        )


if __name__ == "__main__":
    main()
