"""Compare the theory of frames with frames: mean, temporal σ and spatial σ of cameras built to break it.

    python benchmarks/theory.py [--serials 64] [--frames 4] [--cases TEXT …] [--random 200] [--full] [--json]

The cases are the shipped cameras in light from darkness to beyond saturation, or with --random cameras out of wide
ranges, with --full about their full well; 5a4fbc1b:benchmarks/theory_cases.py has 112 more. Each is exposed with many
serials, a few frames each. A standard error is the spread from serial to serial: rows and columns are shared
by the pixels of a serial, serials are independent. The columns are theory, frames and the distance in standard errors
of both sides (z, for σ of the variances), for mean, temporal σ and spatial σ.
The verdict is ok where each of the three lies within 4 standard errors, or σ within 1 % and the mean within 0.02 σ.
By chance one of 5000 distances is above 4. The last column is the processor time of the theory.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import saturation_e

ERRORS, OF_SIGMA, OF_MEAN = 4.0, 0.01, 0.02
QUANTITIES = ("mean", "temporal", "spatial")
V_PER_E, SHAPE = 5e-6, (8, 1024)
PARTS_OF_SATURATION = (0.0, 0.1, 0.9, 1.0, 1.2)


@dataclass(frozen=True)
class Case:
    """A camera, an exposure and an exposure level [mean photoelectrons]."""

    name: str
    camera: ms.Camera
    level_e: float
    exposure: ms.Exposure = ms.Exposure(0.1)  # noqa: RUF009

    def photons(self, shape: tuple[int, int]) -> ms.Photons:
        """Return the photoelectrons of a window."""
        curves = len(self.camera.quantum_efficiency.curves)
        return ms.Photons(
            np.full((*shape, curves), self.level_e), np.arange(curves) + 500.0, detected=True
        )


def shipped_cases() -> list[Case]:
    """Return cameras with one readout at fractions of their saturation."""
    cameras = [one for one in map(ms.load_camera, ms.list_cameras()) if not one.readouts]
    return [
        Case(f"{camera.name} {part:.0%}", camera, part * saturation_e(camera))
        for camera in cameras
        for part in PARTS_OF_SATURATION
    ]


def random_case(number: int) -> Case:
    """Return a camera, an exposure and an exposure level from wide ranges."""
    rng = np.random.default_rng([2024, number])

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    def maybe(chance: float, value: Any, other: Any) -> Any:
        return value if rng.random() < chance else other

    bits, well, gain, read = (
        int(rng.integers(1, 17)),
        log(1.0, 2e5),
        log(0.01, 20.0),
        log(0.05, 100.0),
    )
    changes: dict[str, Any] = {
        "pixel__prnu": maybe(0.7, log(1e-3, 0.3), 0.0),
        "pixel__prnu_distribution": str(rng.choice(["gaussian", "lognormal"])),
        "pixel__dsnu_e": maybe(0.5, log(0.01, 50.0) / gain, 0.0),
        "readout__dsnu_col": maybe(0.5, log(0.01, 50.0) / gain / well, 0.0),
        "readout__prnu_col": maybe(0.2, log(1e-3, 0.05), 0.0),
        "readout__row_noise_e": maybe(0.2, log(0.05, 30.0), 0.0),
        "readout__reset": maybe(0.1, "hard", "true_cds"),
        "adc__black_level_dn": maybe(0.4, 0.0, rng.uniform(0, 0.5 * 2**bits)),
        "dark_current__fom_na_per_cm2": None,
        "dark_current__rate_e_per_s": log(0.01, 1e5),
        "dark_current__at_temperature_k": 300.0,
        "dark_current__cv": maybe(0.8, log(0.01, 10.0), 0.0),
        "dark_current__distribution": str(
            rng.choice(["lognormal", "gamma", "wald", "gaussian", "logistic"])
        ),
        "source_follower__vv_nonlinearity": maybe(0.25, rng.uniform(0.8, 1.2), 1.0),
        "readout__ve_nonlinearity": maybe(0.25, rng.uniform(0.0, 1.0), 0.0),
        "adc__gamma": maybe(0.25, rng.uniform(0.8, 1.3), None),
    }
    if rng.random() < 0.3:
        low = log(1.0, 1e5)
        uniform = {
            "weight": log(1e-3, 0.3),
            "family": "uniform",
            "low": low,
            "high": low * log(1.1, 30),
            "unit": "e",
        }
        normal = {
            "weight": log(1e-2, 0.3),
            "family": "normal",
            "mean": low,
            "sigma": low * log(0.01, 2.0),
            "unit": "e",
        }
        changes["dark_current__components"] = [maybe(0.5, uniform, normal)]
    if rng.random() < 0.2:
        changes["dark_current__rts_fraction"] = log(1e-2, 1.0)
        changes["dark_current__rts_amplitude_e_per_s"] = log(1.0, 1e6)
        changes["dark_current__rts_duty"] = rng.uniform(0.05, 0.95)
        changes["dark_current__rts_switching"] = 1.0
    if rng.random() < 0.15 and 2 <= bits <= 10:
        widths = np.clip(rng.normal(0.0, rng.uniform(0.05, 0.6), 2**bits), -1.0, None)
        changes["adc__dnl_lsb"] = {str(n): float(widths[n]) for n in range(1, 2**bits - 1)}
    changes |= {
        "adc__full_scale_v": 2**bits / gain * V_PER_E,
        "adc__bits": bits,
        "pixel__full_well_e": well,
        "source_follower__read_noise_e": read,
        "source_follower__white_nv_per_rthz": None,
    }
    dotted = {name.replace("__", "."): value for name, value in changes.items()}
    camera = ms.load_camera("konnik_table1").replace(**dotted)
    temperature_k = float(rng.choice([300.0, 300.0, 320.0, 250.0, 77.0]))
    level = maybe(0.1, 0.0, log(min(0.01, well / 10), 3 * well))
    return Case(f"random {number}", camera, level, ms.Exposure(log(1e-4, 10.0), temperature_k))


def full_case(number: int) -> Case:
    """Return a random camera at 0.9 to 2 times its saturation."""
    case, rng = random_case(number), np.random.default_rng([2026, number])
    try:
        full_e = saturation_e(case.camera)
    except (ms.InputError, ValueError):  # no range of codes, or a curve beyond all numbers
        full_e = case.camera.pixel.full_well_e
    return replace(case, name=f"full {number}", level_e=float(rng.uniform(0.9, 2.0)) * full_e)


def theory_of(
    case: Case, shape: tuple[int, int] = SHAPE
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return mean, temporal and spatial variance of the codes [DN, DN²], standard errors, and processor seconds."""
    options: dict[str, Any] = {"serial": 0, "engine": "numpy"}
    frames = ms.expose(case.photons(shape), case.camera, case.exposure, **options)
    start = time.process_time()
    found = frames.theory.averages(frames.stages[-1])
    return np.array(found[:3]), np.array(found.errors), time.process_time() - start


def measured(
    case: Case, serials: int, count: int, shape: tuple[int, int] = SHAPE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean, temporal and spatial variance of frames [DN, DN²], and their standard errors, shape (3,) each."""
    rows, reference = (
        [],
        0.0,
    )  # subtracted from all codes, so squares of small numbers are exact
    first = zlib.crc32(f"{case.name} {case.level_e:g}".encode()) % 10**6  # for other serials
    for serial in range(first, first + serials):
        options: dict[str, Any] = {"serial": serial, "seed": serial, "engine": "numpy"}
        frames = ms.expose(
            case.photons(shape), case.camera, case.exposure, frames=count, **options
        )
        stack = frames.digital.astype(np.float64)
        reference = reference or float(stack.mean())
        pixels = stack.mean(axis=0) - reference
        rows.append((pixels.mean(), (pixels**2).mean(), stack.var(axis=0, ddof=1).mean()))
    mean, square, temporal = np.array(rows).T
    average = mean.mean()
    lost = (
        mean.var(ddof=1) / serials
    )  # because the average of these serials replaces the expected mean
    fixed = square - 2 * average * mean + average**2 - temporal / count + lost
    values = np.stack([mean + reference, temporal, fixed])
    return values.mean(axis=1), values.std(axis=1, ddof=1) / math.sqrt(serials)


def compared(case: Case, serials: int, count: int) -> dict[str, Any]:
    """Return one row of the table.

    theory, frames : [DN], the root of variances.  z : distance in standard errors, of variances.
    close : within 1 % of σ, and 0.02 σ of the mean.  ok : close, or within four standard errors.
    """
    expected, theory_errors, seconds = theory_of(case)
    found, errors = measured(case, serials, count)
    row: dict[str, Any] = {
        "case": case.name,
        "level_e": case.level_e,
        "close": True,
        "ok": True,
    }
    sigma_dn = math.sqrt(max(found[1] + found[2], 0.0))
    rare = 1 / (serials * math.prod(SHAPE))  # what one pixel would have shown
    for k, name in enumerate(QUANTITIES):
        theory, frames = (
            float(x[k]) if k == 0 else math.sqrt(max(x[k], 0.0)) for x in (expected, found)
        )
        z = float(expected[k] - found[k]) / max(math.hypot(errors[k], theory_errors[k]), rare)
        tolerance_dn = OF_MEAN * sigma_dn if k == 0 else OF_SIGMA * frames
        close = abs(theory - frames) <= tolerance_dn
        row[name] = {"theory": theory, "frames": frames, "z": z}
        row["close"] &= close
        row["ok"] &= close or abs(z) <= ERRORS
    return {**row, "seconds": seconds}


def main() -> int:
    """Parse the options, compare, print the table; return 1 if one case disagrees."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--serials", type=int, default=64, help="serials of each case")
    parser.add_argument("--frames", type=int, default=4, help="frames of each serial")
    parser.add_argument("--cases", nargs="+", default=[""], help="parts of the names of cases")
    parser.add_argument(
        "--random", type=int, nargs="+", help="instead: number of random cases, and the first"
    )
    parser.add_argument("--full", action="store_true", help="random cases about saturation")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ms.SensorWarning)  # saturated pixels are wanted
    if options.random:
        count, first = (*options.random, 0)[:2]
        make = full_case if options.full else random_case
        chosen = [make(first + k) for k in range(count)]
    else:
        asked = [text.lower() for text in options.cases]
        chosen = [
            one for one in shipped_cases() if any(text in one.name.lower() for text in asked)
        ]
    rows = []
    for case in chosen:
        rows.append(row := compared(case, options.serials, options.frames))
        if not options.json:
            cells = "".join(
                f"{row[q]['theory']:>15.4f}{row[q]['frames']:>15.4f}{row[q]['z']:>6.1f}"
                for q in QUANTITIES
            )
            verdict = "ok" if row["ok"] else "NOT"
            print(
                f"{row['case'][:29]:30}{row['level_e']:>9.4g}{cells}  {verdict:4}{row['seconds']:.2f} s"
            )
    if options.json:
        print(json.dumps({"serials": options.serials, "frames": options.frames, "rows": rows}))
    else:
        z = max(abs(row[q]["z"]) for row in rows for q in QUANTITIES)
        good, close = (sum(row[key] for row in rows) for key in ("ok", "close"))
        seconds = np.median([row["seconds"] for row in rows])
        print(
            f"{len(rows)} cases, {good} ok, {close} close; largest z {z:.1f}; median {seconds:.2f} s"
        )
    return 0 if all(row["ok"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
