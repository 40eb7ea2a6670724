"""Light groups beside the render of the whole: error bars of their sum, and the time that equal error takes.

    python benchmarks/light_groups.py [--scene night_crossing] [--width 96] [--spp 256] [--seeds 3] [--json]

Both are rendered in turns with the same number of samples, which the groups share, and compared with a reference of
64 times as many. Of all pixels, |z| < 1 should hold in 0.60 to 0.75 and |z| < 2 in 0.90 to 0.97. ``time`` is that of
the groups over that of the whole, in seconds of the processor, ``error`` the median of the groups' errors over that of
the whole, ``equal`` the time of the groups at the error of the whole, error² falling as one over the time.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

REFERENCE = 64
"""Samples of the reference over those that are compared with it."""

Array = NDArray[np.float64]


def main() -> None:
    """Parse the options, render, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="night_crossing")
    parser.add_argument("--groups", nargs="*", default=["auto"], metavar="NAME=IDS")
    parser.add_argument("--camera", default="bayer_2mp")
    parser.add_argument("--exposure-s", type=float, default=0.01)
    parser.add_argument("--width", type=int, default=96)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = measure(asked)
    if asked.json:
        print(json.dumps(found))
        return
    print(f"{'':<8}{'|z| < 1':>9}{'|z| < 2':>9}{'median error':>14}{'seconds':>9}")
    for name in ("groups", "whole"):
        row = found[name]
        print(
            f"{name:<8}{row['within_1']:>9.3f}{row['within_2']:>9.3f}{row['error']:>14.5f}"
            f"{row['seconds']:>9.2f}"
        )
    print(
        f"groups over whole: time {found['time']:.2f}, error {found['error']:.2f}, "
        f"time at equal error {found['equal']:.2f}"
    )


def measure(asked: argparse.Namespace) -> dict[str, Any]:
    """Medians over the seeds."""
    camera, exposure = ms.load_camera(asked.camera), ms.Exposure(asked.exposure_s)
    common = {"width": asked.width, "spectral": "channels", "progress": False}

    def render(spp: int, seed: int, **options: Any) -> ms.Irradiance:
        return ms.render(asked.scene, camera, exposure, spp=spp, seed=seed, **common, **options)

    reference = render(REFERENCE * asked.spp, 1000, denoise=False)
    rows: dict[str, list[dict[str, float]]] = {"groups": [], "whole": []}
    render(asked.spp, 1, light_groups=asked.groups), render(asked.spp, 1)  # compile
    for seed in range(2, asked.seeds + 2):
        for name, options in (("groups", {"light_groups": asked.groups}), ("whole", {})):
            started = time.process_time()
            light = render(asked.spp, seed, **options)
            seconds = time.process_time() - started
            rows[name].append({**compared(light, reference, camera), "seconds": seconds})
    found: dict[str, Any] = {
        name: {key: statistics.median(row[key] for row in several) for key in several[0]}
        for name, several in rows.items()
    }
    found["time"] = found["groups"]["seconds"] / found["whole"]["seconds"]
    found["error"] = found["groups"]["error"] / found["whole"]["error"]
    found["equal"] = found["time"] * found["error"] ** 2
    return found


def compared(
    light: ms.Irradiance, reference: ms.Irradiance, camera: ms.Camera
) -> dict[str, float]:
    """Errors of the light behind each pixel's own filter, and how many error bars hold."""
    own, exact = (of_own_filter(one, camera) for one in (light, reference))
    errors = np.hypot(light.relative_error * own, reference.relative_error * exact)
    lit = (exact > 0) & (errors > 0) & np.isfinite(errors)
    z = np.abs(own - exact)[lit] / errors[lit]
    return {
        "within_1": float((z < 1).mean()),
        "within_2": float((z < 2).mean()),
        "error": float(np.median(np.abs(own - exact)[lit] / exact[lit])),
    }


def of_own_filter(light: ms.Irradiance, camera: ms.Camera) -> Array:
    """Light of the channel of each pixel, (H, W)."""
    rows, columns = np.indices(light.data.shape[:2])
    tile = np.array(camera.tile)
    row, column = light.origin
    number = tile[(rows + row) % tile.shape[0], (columns + column) % tile.shape[1]]
    return np.take_along_axis(light.data, number[..., None], axis=2)[..., 0].astype(np.float64)


if __name__ == "__main__":
    main()
