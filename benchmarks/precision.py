"""Compare float32 and float64 frames for the same random bits: share of pixels that differ, largest difference.

    python benchmarks/precision.py [--pixels 400000] [--bits 8 12 14 16] [--json]

The light is a ramp from darkness to more than the full well, for several resolutions and full wells, then with each
option of the camera switched on alone. If more than 1 % of the pixels or any pixel by more than 1 DN differ, a plan
chooses float64 (column "plan"; it is computed from 16 384 pixels).
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np

import mitsuba_sensor as ms

BITS, FULL_WELLS_E = (8, 12, 14, 16), (1e3, 1e4, 33_000.0, 1e5, 1e6)
EXPOSURE = ms.Exposure(0.1)
PLAIN = ms.load_camera("konnik_table1")
OPTIONS: dict[str, dict[str, Any]] = {
    "no option": {},
    "hard reset": {"readout.reset": "hard"},
    "V/e- non-linearity": {"readout.ve_nonlinearity": 0.05},
    "V/V non-linearity": {"source_follower.vv_nonlinearity": 1.05},
    "ADC non-linearity": {"adc.gamma": 1.04},
    "gamma dark FPN": {"dark_current.distribution": "gamma", "dark_current.cv": 0.4},
    "Wald dark FPN": {"dark_current.distribution": "wald", "dark_current.cv": 0.4},
    "logistic dark FPN": {"dark_current.distribution": "logistic", "dark_current.cv": 0.4},
    "PRNU_col": {"readout.prnu_col": 0.01},
    "DSNU_row, DSNU_pixel": {"readout.dsnu_row": 1e-3, "pixel.dsnu_e": 10.0},
    "quantum yield": {"quantum_efficiency.quantum_yield": [2.0, 2.0]},
    "all non-linearities": {},
}
OPTIONS["all non-linearities"] = {
    key: value for change in list(OPTIONS.values())[1:5] for key, value in change.items()
}


def main() -> None:
    """Parse the options, compare, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--pixels", type=int, default=400_000, help="pixels of each frame (default 400000)"
    )
    parser.add_argument(
        "--bits", type=int, nargs="+", default=BITS, help="resolutions (default 8 12 14 16)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    start = time.perf_counter()
    rows = [
        compared(
            PLAIN.replace(**{"adc.bits": bits, "pixel.full_well_e": well}),
            f"{well:g} e-",
            options.pixels,
        )
        for well in FULL_WELLS_E
        for bits in options.bits
    ]
    rows += [
        compared(PLAIN.replace(**{"adc.bits": bits, **change}), name, options.pixels)
        for name, change in OPTIONS.items()
        for bits in options.bits
    ]
    if options.json:
        print(
            json.dumps(
                {"pixels": options.pixels, "rows": rows, "seconds": time.perf_counter() - start}
            )
        )
        return
    print(f"{'':24}{'bits':>5}{'pixels that differ':>20}{'largest':>10}   plan")
    for row in rows:
        share = f"{100 * row['share_of_pixels']:.3g} %"
        print(
            f"{row['case']:24}{row['bits']:>5}{share:>20}{row['largest_dn']:>7g} DN   {row['plan']}"
        )


def compared(camera: ms.Camera, case: str, pixels: int) -> dict[str, Any]:
    """One frame in both precisions, and the precision that the plan chooses."""
    width = 1000
    light = np.linspace(
        0, 1.1 * camera.pixel.full_well_e / 0.3, pixels // width * width
    ).reshape(-1, width)
    single, double = (
        ms.expose(light, camera, EXPOSURE, engine="numpy", precision=precision).digital
        for precision in ("float32", "float64")
    )
    steps = np.abs(np.subtract(single, double, dtype=float))
    return {
        "case": case,
        "bits": camera.adc.bits,
        "full_well_e": camera.pixel.full_well_e,
        "share_of_pixels": float(np.mean(steps > 0)),
        "largest_dn": int(steps.max()),
        "plan": ms.plan(camera, EXPOSURE, light).precision,
    }


if __name__ == "__main__":
    main()
