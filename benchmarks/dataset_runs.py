"""Measure a dataset: bytes and seconds of a sample, and the shards of runs that are killed repeatedly.

    python benchmarks/dataset_runs.py [--samples 40] [--width 64] [--kills 20] [--json]

Each killed run ends by SIGKILL at a random time. After each, every shard must have the SHA-256 that its name says; the
last run must leave the shards of an undisturbed one, byte by byte.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TEXT = """name = "timed"
outputs = ["raw", "clean"]
render = {{spp = 16, width = {width}}}
scenes = [{{name = "flat", file = "scenes/flat_field.xml"}}]
cameras = [{{camera = "bayer_2mp"}}]
grid = {{exposure_s = [0.01, 0.02], "parameters.radiance" = {levels}}}
"""


def start(file: Path, folder: Path) -> subprocess.Popen[bytes]:
    """Start a run that continues where the last one ended."""
    command = [
        sys.executable,
        "-m",
        "mitsuba_sensor",
        "dataset",
        "run",
        str(file),
        "-o",
        str(folder),
    ]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL)


def shards(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each shard by name."""
    files = sorted(folder.rglob("*.tar"))
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--samples", type=int, default=40, help="samples, two of each render")
    parser.add_argument("--width", type=int, default=64, help="columns of a frame")
    parser.add_argument("--kills", type=int, default=20, help="runs that are killed")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    asked = parser.parse_args()
    chance, torn = random.Random(1), 0
    with tempfile.TemporaryDirectory() as place:
        file, whole, killed = (Path(place, name) for name in ("timed.toml", "whole", "killed"))
        levels = [1e-4 * k for k in range(1, max(asked.samples // 2, 1) + 1)]
        file.write_text(TEXT.format(width=asked.width, levels=levels), "utf-8")
        began = time.perf_counter()
        if start(file, whole).wait():
            raise SystemExit("the undisturbed run failed")
        seconds = time.perf_counter() - began
        for _ in range(asked.kills):
            run = start(file, killed)
            time.sleep(chance.uniform(0, seconds))
            run.kill()
            run.wait()
            torn += sum(digest not in name for name, digest in shards(killed).items())
        start(file, killed).wait()
        size = sum(path.stat().st_size for path in whole.rglob("*") if path.is_file())
        found = {
            "bytes_per_sample": size / (2 * len(levels)),
            "seconds_per_sample": seconds / (2 * len(levels)),
            "kills": asked.kills,
            "torn_shards": torn,
            "same_bytes": shards(whole) == shards(killed) != {},
        }
    print(
        json.dumps(found) if asked.json else "\n".join(f"{k:20}{v}" for k, v in found.items())
    )
    return 0 if found["same_bytes"] and not torn else 1


if __name__ == "__main__":
    sys.exit(main())
