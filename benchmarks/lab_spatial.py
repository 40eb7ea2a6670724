"""Compare DSNU1288 and PRNU1288 of mitsuba_sensor.lab with those of the emva1288 package, on the same frames.

20 random cameras of ms.expose: dark and half-saturated frames of each. Printed for every figure: the largest
difference of the two, and the mean distance of each from the datasheet, all relative to it. emva1288 1.0.2 needs
numpy.asfarray, which NumPy 2 has no longer; it is supplied here.

    pip install emva1288 && python benchmarks/lab_spatial.py
"""

from __future__ import annotations

import argparse
import json
import logging
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.nonuniformity import Nonuniformity, nonuniformity
from mitsuba_sensor.sensor.gains import gain_dn_per_e

EXPOSURE = ms.Exposure(0.1)
FIGURES = ("dsnu", "dsnu_row", "dsnu_col", "dsnu_pixel", "prnu", "prnu_row", "prnu_col", "prnu_pixel")


def camera_of(rng: np.random.Generator) -> ms.Camera:
    """Table 1 with other non-uniformities, full well, dark current and depth."""
    return ms.load_camera("konnik_table1").replace(
        **{
            "pixel.prnu": float(rng.uniform(0.004, 0.02)),
            "pixel.full_well_e": float(rng.uniform(10_000, 60_000)),
            "dark_current.fom_na_per_cm2": float(rng.uniform(0.2, 0.8)),
            "dark_current.cv": float(rng.uniform(0.1, 0.3)),
            "dark_current.distribution": "gaussian",
            "readout.dsnu_col": float(rng.uniform(2e-4, 1e-3)),
            "readout.dsnu_row": float(rng.uniform(2e-4, 1e-3)),
            "readout.prnu_col": float(rng.uniform(0.002, 0.01)),
            "adc.bits": int(rng.choice([12, 14])),
        }
    )


def known(camera: ms.Camera) -> dict[str, float]:
    """What the datasheet says of it: DSNU [DN] and PRNU [%]. PRNU_col multiplies dark electrons too."""
    gain, well, readout = gain_dn_per_e(camera), camera.pixel.full_well_e, camera.readout
    dark_e = 1741.58 * camera.dark_current.fom_na_per_cm2 * EXPOSURE.time_s  # 298.15 K, 1 nA/cm², pixels of 5.7 µm
    found = {
        "dsnu_row": readout.dsnu_row * well * gain,
        "dsnu_col": math.hypot(readout.dsnu_col * well, readout.prnu_col * dark_e) * gain,
        "dsnu_pixel": dark_e * camera.dark_current.cv * gain,
        "prnu_col": 100 * readout.prnu_col * math.sqrt(1 + 2 * dark_e / (0.5 * well)),
        "prnu_pixel": 100 * camera.pixel.prnu,
    }
    found["dsnu"] = math.hypot(found["dsnu_row"], found["dsnu_col"], found["dsnu_pixel"])
    return found | {"prnu": math.hypot(found["prnu_pixel"], found["prnu_col"]), "prnu_row": 0.0}


def emva1288_of(dark: NDArray[Any], light: NDArray[Any]) -> dict[str, float]:
    """The same figures of the emva1288 package; NaN where it takes the root of a negative number."""
    np.asfarray = lambda a, dtype=float: np.asarray(a, dtype)  # type: ignore[attr-defined]
    logging.disable(logging.INFO)
    from emva1288.process.data import Data1288
    from emva1288.process.results import Results1288
    from emva1288.process.routines import get_int_imgs

    height, width = dark.shape[1:]
    spatial = {0.1: {0.0: get_int_imgs(list(dark)), 1e4: get_int_imgs(list(light))}}
    pairs = {level: get_int_imgs(list(frames[:2])) for level, frames in ((0.0, dark), (1e4, light))}
    sums = {level: {**one, "sum": one["sum"].sum(), "pvar": one["pvar"].sum()} for level, one in pairs.items()}
    data = Data1288({"width": width, "height": height, "temporal": {0.1: sums}, "spatial": spatial})
    result = Results1288(data.data)
    squares = {"": "", "_row": "_row", "_col": "_col", "_pixel": "_pixel"}
    found = {f"dsnu{part}": getattr(result, f"s_2_y{name}_dark") ** 0.5 for part, name in squares.items()}
    with np.errstate(invalid="ignore"):
        return found | {f"prnu{part}": float(getattr(result, f"PRNU1288{part}")) for part in squares}


def measured(camera: ms.Camera, serial: int, shape: tuple[int, int], frames: int) -> tuple[Nonuniformity, Any]:
    """Ours, and the frames."""
    photons = np.full(shape, 0.5 * camera.pixel.full_well_e / 0.6)
    dark, light = (
        ms.expose(photons * lit, camera, EXPOSURE, frames=frames, serial=serial, seed=2 * serial + lit).digital
        for lit in (0, 1)
    )
    return nonuniformity(*(Stack(one, EXPOSURE.time_s, bits=camera.adc.bits) for one in (dark, light))), (dark, light)


def compared(cameras: int, shape: tuple[int, int], frames: int) -> dict[str, dict[str, float]]:
    """For every figure: largest difference, mean distances from the datasheet, share of our intervals that cover it."""
    rng = np.random.default_rng(1288)
    rows: dict[str, list[tuple[float, float, float, bool]]] = {name: [] for name in FIGURES}
    for serial in range(1, cameras + 1):
        camera = camera_of(rng)
        ours, (dark, light) = measured(camera, serial, shape, frames)
        theirs = emva1288_of(dark, light)
        for name, value in known(camera).items():
            one = getattr(ours, name)
            rows[name].append((one.value, theirs[name], value, one.covers(value)))
    return {name: summary(np.array(some, float)) for name, some in rows.items()}


def summary(rows: NDArray[np.float64]) -> dict[str, float]:
    """Of ours, theirs, the datasheet's and whether ours covers it; where that is 0, of the values themselves."""
    ours, theirs, value, covered = rows.T
    scale = value if value.all() else np.ones(len(value))
    return {
        "largest difference": float(np.nanmax(np.abs(ours - theirs) / scale)),
        "ours from the datasheet": float(np.mean(np.abs(ours - value) / scale)),
        "emva1288 from the datasheet": float(np.nanmean(np.abs(theirs - value) / scale)),
        "emva1288 without a value": float(np.mean(np.isnan(theirs))),
        "intervals that cover the datasheet": float(covered.mean()),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cameras", type=int, default=20)
    parser.add_argument("--size", type=int, nargs=2, default=(300, 400), help="rows and columns")
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found = compared(given.cameras, tuple(given.size), given.frames)
    if given.json:
        print(json.dumps(found, indent=1))
        return
    for name, figures in found.items():
        print(f"{name:11}", *(f"{key} {value:.2%}" for key, value in figures.items()), sep="  ")


if __name__ == "__main__":
    main()
