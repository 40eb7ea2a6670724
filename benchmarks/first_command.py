"""Measure time and memory of the README's first command, as a whole process, scalar and LLVM.

    python benchmarks/first_command.py [--runs 5] [--width 384] [--json]

The variants run alternately, so that other load on the machine affects both. The first run (cold caches, compilation of
kernels) is reported separately from the median of the others. Peak memory is ru_maxrss of the child process.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from timing import lines

ROOT = Path(__file__).resolve().parent.parent
VARIANTS = ("scalar_spectral", "llvm_ad_spectral")


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, help="warm runs of each variant")
    parser.add_argument("--width", type=int, default=384, help="width [pixels]; height is 2/3")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    turns = [
        {name: once(name, options.width) for name in VARIANTS} for _ in range(options.runs + 1)
    ]
    results = {
        **vars(options),
        "cpus": os.cpu_count(),
        "variants": {name: digest([turn[name] for turn in turns]) for name in VARIANTS},
    }
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def once(variant: str, width: int) -> dict[str, Any]:
    """Run one process; return its seconds, seconds of rendering, and peak memory."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as output:
        arguments = [
            "render",
            str(ROOT / "scenes" / "first_frame.xml"),
            "-o",
            folder,
            "--variant",
            variant,
        ]
        arguments += ["-D", f"width={width}", "-D", f"height={width * 2 // 3}"]
        start = time.perf_counter()
        child = subprocess.Popen(
            [sys.executable, "-m", "mitsuba_sensor", *arguments], stdout=output, stderr=output
        )
        _, status, usage = os.wait4(child.pid, 0)
        seconds = time.perf_counter() - start
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            output.seek(0)
            return {"error": output.read().decode().strip().splitlines()[-1]}
        report = json.loads((Path(folder) / "frame.json").read_text(encoding="utf-8"))
        cpu = usage.ru_utime + usage.ru_stime
        return {
            "seconds": seconds,
            "cpu_s": cpu,
            "peak_mb": usage.ru_maxrss / 1024,
            "render_s": report["times_s"]["render"],
        }


def digest(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the first run, and the median of the other runs."""
    for run in runs:
        if "error" in run:
            return run
    warm = [run["seconds"] for run in runs[1:]] or [runs[0]["seconds"]]
    return {
        "first_s": runs[0]["seconds"],
        "warm_s": statistics.median(warm),
        "warm_min_s": min(warm),
        "warm_max_s": max(warm),
        "cpu_s": statistics.median(run["cpu_s"] for run in runs[1:] or runs),
        "render_s": statistics.median(run["render_s"] for run in runs[1:] or runs),
        "peak_mb": max(run["peak_mb"] for run in runs),
    }


if __name__ == "__main__":
    main()
