"""Seconds that a frame or a render is spared because what it does not need is left out, each measured both ways.

    python benchmarks/left_out.py [--turns 5] [--width 192] [--spp 32] [--json]

Both runs of a pair take turns. The whole is what would be computed if nothing were left out.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from cases import EXPOSURE, shape_of
from timing import alternate

import mitsuba_sensor as ms

SCENES = Path(__file__).resolve().parents[1] / "scenes"
Task = Callable[[], object]


def main() -> None:
    """Parse the options, measure every pair, print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=5, help="measured turns (default 5)")
    parser.add_argument("--width", type=int, default=192, help="columns of the renders")
    parser.add_argument("--spp", type=int, default=32, help="samples per pixel of the renders")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    pairs = of_frames() | of_renders(options.width, options.spp)
    rows = [row(name, pair, options.turns) for name, pair in pairs.items()]
    if options.json:
        print(json.dumps(rows))
        return
    print("| left out | with it [s] | without [s] | spared |\n|---|---|---|---|")
    for one in rows:
        with_s, without_s = one["with_s"], one["without_s"]
        spared = 1 - without_s / with_s
        print(f"| {one['name']} | {with_s:.3g} | {without_s:.3g} | {100 * spared:.0f} % |")


def row(name: str, pair: tuple[Task, Task], turns: int) -> dict[str, Any]:
    """Median seconds of both tasks of a pair."""
    seconds = alternate({"with": pair[0], "without": pair[1]}, turns)
    medians = {f"{key}_s": statistics.median(values) for key, values in seconds.items()}
    return {"name": name, **medians}


def of_frames() -> dict[str, tuple[Task, Task]]:
    """Pairs of one frame of 1 Mpx on NumPy."""
    camera = ms.load_camera("konnik_table1")
    nothing = {
        "readout.row_noise_e": 1e-9,
        "readout.column_noise_e": 1e-9,
        "readout.prnu_col": 1e-9,
        "pixel.dsnu_e": 1e-9,
        "adc.gamma": 1 + 1e-9,
    }
    photons = np.full(shape_of(1.0), 3000.0)

    def frame(camera: ms.Camera, **options: Any) -> ms.Frames:
        return ms.expose(photons, camera, EXPOSURE, engine="numpy", **options)

    plain = partial(frame, camera)
    return {
        "five stages whose value is neutral": (
            partial(frame, camera.replace(**nothing)),
            plain,
        ),
        "float64 where float32 is enough": (partial(frame, camera, precision="float64"), plain),
        "theory of a frame that nobody asked for": (lambda: frame(camera).report, plain),
        "a plan that nobody asked for": (partial(frame, camera, tolerance_dn=0.0), plain),
    }


def of_renders(width: int, spp: int) -> dict[str, tuple[Task, Task]]:
    """Pairs of one render."""
    options: dict[str, Any] = {"width": width, "spp": spp, "denoise": False}

    def render(scene: str, camera: str = "bayer_2mp", **more: Any) -> object:
        exposure = ms.Exposure(0.02)
        loaded = ms.load_camera(camera)
        return ms.render(SCENES / scene, loaded, exposure, **(options | more))

    def capture(**more: Any) -> object:
        loaded = ms.load_camera("bayer_2mp")
        box = SCENES / "cornell_box.xml"
        return ms.capture(box, loaded, ms.Exposure(0.02), **(options | more))

    box, fan = "cornell_box.xml", "rolling_fan.xml"
    turning = {"axis": [0, 0, 1], "pivot_m": [0, 0, 0]}
    slow, fast = (
        {"objects": {"fan": {"rotate_deg_per_s": x, **turning}}} for x in (0.01, 9000.0)
    )
    return {
        "bands of other cameras (cube of this one's)": (
            partial(render, box, spectral="cube"),
            partial(render, box, spectral="channels"),
        ),
        "AOVs": (partial(capture, aovs=True), capture),
        "guides and network of the denoiser": (
            partial(render, box, denoise=True),
            partial(render, box),
        ),
        "instants of a motion slower than half a pixel": (
            partial(render, fan, motion=fast),
            partial(render, fan, motion=slow),
        ),
    }


if __name__ == "__main__":
    main()
