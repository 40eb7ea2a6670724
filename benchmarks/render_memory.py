"""Measure the peak memory of a render with a million pixels and 31 bands.

python benchmarks/render_memory.py            # 1024 × 1024 × 31, about half a minute
python benchmarks/render_memory.py --quick    # only checks that the script runs
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms

SCENE = Path(__file__).parent.parent / "scenes" / "flat_field.xml"


def peak_mib() -> float:
    """Peak resident memory of this process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", type=Path, default=SCENE)
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--no-denoise", action="store_true", help="the render itself")
    parser.add_argument("--quick", action="store_true", help="64 × 64 pixels: a check of the script")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    size = 64 if options.quick else 1024
    curve = {"wavelengths_nm": [400.0, 710.0], "curves": {"mono": [0.6, 0.6]}, "reference_nm": 550.0}
    camera = ms.load_camera("konnik_table1").replace(**{f"quantum_efficiency.{k}": v for k, v in curve.items()})
    exposure, started = ms.Exposure(0.02), time.perf_counter()
    asked = {"parameters": {"width": size, "height": size}, "denoise": False if options.no_denoise else None}
    light = ms.render(options.scene, camera, exposure, spp=options.spp, bandwidth_nm=10, **asked)
    rendered, seconds = peak_mib(), time.perf_counter() - started
    photons = ms.collect(light, camera, exposure)
    frames = ms.expose(photons, camera, exposure)
    bands = light.data.shape[2]
    if options.json:
        print(json.dumps({"pixels": size**2, "bands": bands, "render_mib": rendered, "frame_mib": peak_mib()}))
        return
    print(f"{size} × {size} × {bands} bands, {light.statistics.samples_per_pixel} samples, {seconds:.1f} s")
    print(f"peak memory of the render {rendered:.0f} MiB, with photons and a frame {peak_mib():.0f} MiB")
    assert np.isfinite(light.data).all() and frames.digital.shape == (1, size, size)


if __name__ == "__main__":
    main()
