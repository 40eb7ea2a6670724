"""Speed of ms.SensorNoise as a script calls it: images of one megapixel, one after the other.

    python benchmarks/sensor_noise.py [--side 1024] [--images 30] [--json]

For grey electrons, linear and sRGB colour, raw and developed; the first image, which compiles, apart.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np

import mitsuba_sensor as ms

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "electrons, raw": ("sony_imx174", {"values": "electrons"}),
    "linear RGB, raw": ("bayer_2mp", {"values": "linear", "white_e": 2000.0}),
    "sRGB of 8 bits, raw": ("bayer_2mp", {"values": "srgb", "white_e": 2000.0}),
    "linear RGB, raw, chip drawn": ("bayer_2mp", {"values": "linear", "white_e": 2000.0, "serial": (1, 10**6)}),
    "sRGB of 8 bits, developed": ("bayer_2mp", {"values": "srgb", "white_e": 2000.0, "output": "developed"}),
}
SLOW = 5
"""So many times fewer images where each takes long."""


def measured(side: int, images: int) -> dict[str, dict[str, float]]:
    """Seconds of the first image and megapixels a second of the others, medians, wall time."""
    chance, found = np.random.default_rng(1), {}
    for name, (camera, options) in CASES.items():
        noise = ms.SensorNoise(camera, **options)
        image = chance.uniform(0, 1, (side, side, 3)).astype(np.float32)
        if options["values"] == "electrons":
            image = 2000 * image[..., 0]
        if "8 bits" in name:
            image = (255 * image).astype(np.uint8)
        seconds = []
        for number in range(1 + (images // SLOW if "developed" in name or "drawn" in name else images)):
            start = time.perf_counter()
            noise(image, number)
            seconds.append(time.perf_counter() - start)
        found[name] = {"first_s": seconds[0], "mpx_per_s": 1e-6 * side**2 / float(np.median(seconds[1:]))}
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, default=1024, help="rows, and as many columns")
    parser.add_argument("--images", type=int, default=30)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    result = measured(asked.side, asked.images)
    if asked.json:
        print(json.dumps(result))
    else:
        for name, one in result.items():
            print(f"{name:30} first {one['first_s']:6.2f} s, then {one['mpx_per_s']:7.1f} Mpx/s")
