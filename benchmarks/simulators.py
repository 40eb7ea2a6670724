"""Three data sheets through five simulators; what emva1288 and our lab measure in their frames.

    pip install '.[peers]' && python benchmarks/simulators.py [--simulators getframes galsim] [--json]
    python benchmarks/simulators.py --plot docs/images/readme_simulators.png [--turns 5] [--json]

Constant light, 50 exposure times from near darkness to 1.1 times the saturation, two dark and two bright frames of
each, and 32 of both at half of the saturation for the spatial figures. A cell has the figure of emva1288, then that of
our lab. Saturation is where the variance is largest, which lies below the full well. Speed and memory are those of
one frame of a million pixels at saturation, set-up included.

``--plot`` draws the error of frames against their run time: every simulator, and this package on each engine, with the
stages that all of them have (shot noise, dark current, read noise, black level, rounding) at 100 photoelectrons.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from datasheets import SHEETS, TEMPERATURE_K, Datasheet, camera_of
from simulated import SIMULATORS, Codes, Shot
from timing import alternate, in_child, ratio, speeds

import mitsuba_sensor as ms
from mitsuba_sensor.core.versions import machine
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.dark_current import dark_current
from mitsuba_sensor.lab.measure.emva_linear import emva_linear
from mitsuba_sensor.lab.measure.nonuniformity import nonuniformity
from mitsuba_sensor.pages.drawing import png
from mitsuba_sensor.pages.page import Plot, line

Figures = dict[str, float]
SPATIAL_FRAMES = 32
TIMED_SHAPE, PLOTTED_SHAPE, SMALL = (1000, 1000), (500, 500), (8, 8)
SHARED_ELECTRONS, FRAMES_A_CALL = 100.0, 8
OUR_ENGINES = {
    "NumPy float64": {"engine": "numpy", "precision": "float64"},
    "NumPy float32": {"engine": "numpy", "precision": "float32"},
    "Dr.Jit float32": {"engine": "drjit", "precision": "float32"},
}
UNITS = {
    "K": "DN/e-",
    "QE": "1",
    "σ_d": "e-",
    "DSNU": "e-",
    "PRNU": "%",
    "LE": "%",
    "dark current": "e-/s",
    "saturation": "e-",
}


@dataclass(frozen=True)
class Series:
    """Frames of one simulator: by exposure time, dark and bright; and stacks at half of the saturation."""

    sheet: Datasheet
    times_s: list[float]
    photons: list[float]
    darks: list[Codes]
    flats: list[Codes]
    dark_stack: Codes
    flat_stack: Codes

    @property
    def middle(self) -> int:
        """Number of the level whose stacks are taken."""
        return len(self.times_s) // 2


def of_sheet(sheet: Datasheet) -> Figures:
    """What should be measured. Light is the quantity that the converter or the well ends."""
    return {
        "K": sheet.gain_dn_per_e,
        "QE": sheet.qe,
        "σ_d": sheet.read_noise_e,
        "DSNU": sheet.dsnu_e,
        "PRNU": 100 * sheet.prnu,
        "LE": 0.0,
        "dark current": sheet.dark_e_per_s,
        "saturation": sheet.saturation_e,
    }


def series_of(simulator: str, sheet: Datasheet, levels: int, side: int) -> Series:
    """The bench series of a simulated camera.  levels : exposure times.  side : rows, and as many columns."""
    rate = 1.1 * sheet.saturation_e / sheet.qe / sheet.longest_s
    times = (sheet.longest_s * np.linspace(1 / levels, 1, levels)).tolist()
    half_s = times[levels // 2]

    def frames(photons: float, time_s: float, count: int, seed: int) -> Codes:
        return SIMULATORS[simulator](sheet, Shot(photons, time_s, count, seed, (side, side)))

    return Series(
        sheet,
        times,
        photons=[rate * one for one in times],
        darks=[frames(0.0, one, 2, 2 * i) for i, one in enumerate(times)],
        flats=[frames(rate * one, one, 2, 2 * i + 1) for i, one in enumerate(times)],
        dark_stack=frames(0.0, half_s, SPATIAL_FRAMES, 1001),
        flat_stack=frames(rate * half_s, half_s, SPATIAL_FRAMES, 1002),
    )


def by_our_lab(series: Series) -> Figures:
    """Figures of mitsuba_sensor.lab."""
    bits = series.sheet.bits
    darks = [
        Stack(one, t, photons=0.0, bits=bits)
        for one, t in zip(series.darks, series.times_s, strict=True)
    ]
    flats = [
        Stack(one, t, photons=light, bits=bits)
        for one, t, light in zip(series.flats, series.times_s, series.photons, strict=True)
    ]
    found = emva_linear(darks, flats)
    gain = found["K"]
    half = series.times_s[series.middle]
    stacks = [Stack(one, half, bits=bits) for one in (series.dark_stack, series.flat_stack)]
    spatial = nonuniformity(*stacks)
    current = dark_current(darks).from_mean.in_electrons(gain)
    return {
        "K": gain.value,
        "QE": found["η"].value,
        "σ_d": found["σ_d"].value,
        "DSNU": spatial.dsnu.in_electrons(gain).value,
        "PRNU": spatial.prnu.value,
        "LE": found["LE"].value,
        "dark current": current.value,
        "saturation": found["µ_e.sat"].value,
    }


def by_emva1288(series: Series) -> Figures:
    """Figures of the package of the standard's authors, which asks for a function that NumPy 2 has no more."""
    np.asfarray = lambda values, dtype=float: np.asarray(values, dtype)  # type: ignore[attr-defined]
    from emva1288.process.data import Data1288
    from emva1288.process.results import Results1288
    from emva1288.process.routines import get_int_imgs

    def sums(frames: Codes) -> dict[str, Any]:
        found = get_int_imgs(list(frames))
        return {key: found[key].sum() for key in ("sum", "pvar")} | {"dmean": found["dmean"]}

    times_ns = [1e9 * one for one in series.times_s]
    temporal = {
        t: {0.0: sums(dark), light: sums(flat)}
        for t, dark, light, flat in zip(
            times_ns, series.darks, series.photons, series.flats, strict=True
        )
    }
    spatial = {
        0.0: get_int_imgs(list(series.dark_stack)),
        series.photons[series.middle]: get_int_imgs(list(series.flat_stack)),
    }
    data = {
        "temporal": temporal,
        "spatial": {times_ns[series.middle]: spatial},
        "height": series.dark_stack.shape[1],
        "width": series.dark_stack.shape[2],
    }
    found = Results1288(Data1288(data, loglevel=50).data, loglevel=50)
    deviation = found.linearity()["relative_deviation"]
    inside = slice(found.index_linearity_min, found.index_linearity_max + 1)
    return {
        "K": found.K,
        "QE": found.QE / 100,
        "σ_d": found.sigma_d,
        "DSNU": found.DSNU1288,
        "PRNU": found.PRNU1288,
        "LE": float(np.mean(np.abs(deviation[inside]))),
        "dark current": found.u_I_mean,
        "saturation": found.u_e_sat,
    }


def brightest(simulator: str, sheet: Datasheet, shape: tuple[int, int]) -> Callable[[], Codes]:
    """Takes one frame at saturation, set-up included."""
    shot = Shot(sheet.saturation_e / sheet.qe, sheet.longest_s, 1, 1, shape)
    return partial(SIMULATORS[simulator], sheet, shot)


def memory_mb(simulator: str, sheet: str) -> float:
    """Largest memory of a process with a frame of a million pixels, above that with a small one [MB]."""
    quiet()
    brightest(simulator, SHEETS[sheet], SMALL)()
    before = _peak_kb()
    brightest(simulator, SHEETS[sheet], TIMED_SHAPE)()
    return (_peak_kb() - before) / 1024


def _peak_kb() -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0])


def cost(simulators: list[str], sheet: str, turns: int) -> dict[str, dict[str, float]]:
    """Speed [Mpx/s], measured in turns, and memory of each simulator."""
    tasks = {one: brightest(one, SHEETS[sheet], TIMED_SHAPE) for one in simulators}
    found = speeds(alternate(tasks, turns), math.prod(TIMED_SHAPE), simulators[0])
    return {
        one: {
            "mpx_per_s": found[one]["mpx_per_s"],
            "memory_mb": in_child("simulators", "memory_mb", one, sheet),
        }
        for one in simulators
    }


class Timed:
    """A simulator's frames, eight in each call: a task of ``alternate``.

    frames_of : (sheet, shot) to frames.  sheet : without spatial noise, which belongs to the sensor unit.
    """

    runs = FRAMES_A_CALL

    def __init__(self, frames_of: Callable[[Datasheet, Shot], Codes], sheet: Datasheet) -> None:
        self.frames_of, self.sheet = frames_of, sheet
        self.calls: list[Codes] = []

    def __call__(self) -> None:
        photons, seed = SHARED_ELECTRONS / self.sheet.qe, 1 + len(self.calls)
        shot = Shot(photons, 1.0, FRAMES_A_CALL, seed, PLOTTED_SHAPE)
        self.calls.append(self.frames_of(self.sheet, shot))

    def error_dn(self) -> float:
        """The larger difference of mean and temporal σ from their closed forms, over all calls."""
        mean_dn = np.mean([frames.mean(dtype=float) for frames in self.calls])
        variance_dn2 = np.mean([np.var(one, 0, float, ddof=1).mean() for one in self.calls])
        law = shared_law_dn(self.sheet)
        return float(max(abs(mean_dn - law[0]), abs(np.sqrt(variance_dn2) - law[1])))


def shared_law_dn(sheet: Datasheet) -> tuple[float, float]:
    """Mean and temporal σ [DN] of Poisson electrons, normal read noise and rounding (EMVA 1288, eq. 11)."""
    mean_e = SHARED_ELECTRONS + sheet.dark_e_per_s
    variance_e2 = mean_e + sheet.read_noise_e**2
    sigma_dn = math.sqrt(sheet.gain_dn_per_e**2 * variance_e2 + 1 / 12)
    return sheet.gain_dn_per_e * mean_e + sheet.black_level_dn, sigma_dn


def on_engine(options: dict[str, Any], sheet: Datasheet, shot: Shot) -> Codes:
    """Frames of this package on one engine, one after the other."""
    light = np.full(shot.shape, shot.photons)
    exposure = ms.Exposure(shot.time_s, temperature_k=TEMPERATURE_K)
    frames = ms.stream(
        light, camera_of(sheet), exposure, seed=shot.seed, frames=shot.frames, **options
    )
    return np.stack(list(frames))


def work_precision(simulators: list[str], turns: int) -> dict[str, dict[str, float]]:
    """Run time and error of every simulator, and of this package on each engine, timed in turns."""
    sheet = replace(SHEETS["industrial CMOS"], prnu=0.0, dsnu_e=0.0)
    tasks = {
        f"this package, {name}": Timed(partial(on_engine, options), sheet)
        for name, options in OUR_ENGINES.items()
    }
    tasks |= {
        name: Timed(SIMULATORS[name], sheet) for name in simulators if name != "mitsuba_sensor"
    }
    seconds = alternate(tasks, turns)
    first = seconds["this package, NumPy float64"]
    pixels, fastest = math.prod(PLOTTED_SHAPE), seconds["this package, Dr.Jit float32"]
    return {
        name: {
            "ns_per_pixel": 1e9 * float(np.median(seconds[name])) / pixels,
            "error_dn": task.error_dn(),
            "times_as_fast_as_float64": ratio(first, seconds[name]),
            "drjit_times_as_fast": ratio(seconds[name], fastest),
        }
        for name, task in tasks.items()
    }


def plot_of(results: dict[str, dict[str, float]], turns: int) -> Plot:
    """Error against run time; the level is what this many frames can tell."""
    sigma_dn = shared_law_dn(SHEETS["industrial CMOS"])[1]
    error_dn = sigma_dn / math.sqrt((turns + 1) * FRAMES_A_CALL * math.prod(PLOTTED_SHAPE))
    lines = [
        line(name, [(one["ns_per_pixel"], max(one["error_dn"], error_dn / 10))], joined=False)
        for name, one in results.items()
    ]
    title, axis = "Frame error versus run time", "error of mean or temporal σ [DN]"
    levels = {"2 standard errors": 2 * error_dn}
    return Plot(title, "run time [ns/pixel]", axis, tuple(lines), levels=levels)


def results_of(asked: argparse.Namespace, simulators: list[str], sheet: str) -> dict[str, Any]:
    """The sheet; by simulator: figures by both packages, if they are installed, speed and memory."""
    costs = cost(simulators, sheet, asked.turns)
    results: dict[str, Any] = {"sheet": of_sheet(SHEETS[sheet])}
    for one in simulators:
        series = series_of(one, SHEETS[sheet], asked.levels, asked.side)
        figures = {name: measure(series) for name, measure in packages().items()}
        results[one] = {"figures": figures, **costs[one]}
    return results


def quiet() -> None:
    """Saturated levels are wanted, and a simulator without DSNU has roots of negative variances."""
    warnings.simplefilter("ignore")


def packages() -> dict[str, Callable[[Series], Figures]]:
    """emva1288 where it is installed, and our lab."""
    ours: dict[str, Callable[[Series], Figures]] = {"our lab": by_our_lab}
    if find_spec("emva1288"):
        return {"emva1288": by_emva1288, **ours}
    return ours


def table(name: str, results: dict[str, Any]) -> list[str]:
    """A Markdown table of a sheet: a row per figure, a column per simulator."""
    found = {one: of for one, of in results.items() if one != "sheet"}
    lines = [f"{name}: {SHEETS[name].what}", ""]
    lines.append("| figure | sheet | " + " | ".join(found) + " |")
    lines.append("|---|---|" + "---|" * len(found))
    for figure, true in results["sheet"].items():
        cells = [
            " / ".join(f"{of[figure]:.4g}" for of in one["figures"].values())
            for one in found.values()
        ]
        lines.append(f"| {figure} [{UNITS[figure]}] | {true:.4g} | " + " | ".join(cells) + " |")
    for title, key in (("speed [Mpx/s]", "mpx_per_s"), ("memory [MB]", "memory_mb")):
        cells = [f"{one[key]:.3g}" for one in found.values()]
        lines.append(f"| {title} | | " + " | ".join(cells) + " |")
    return lines


def main() -> None:
    """Parse the options, run every simulator that is installed, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sheets", nargs="+", default=list(SHEETS), choices=SHEETS)
    parser.add_argument("--simulators", nargs="+", default=list(SIMULATORS), choices=SIMULATORS)
    parser.add_argument("--levels", type=int, default=50, help="exposure times (default 50)")
    parser.add_argument("--side", type=int, default=256, help="rows and columns (default 256)")
    parser.add_argument("--turns", type=int, default=5, help="timed turns (default 5)")
    parser.add_argument("--plot", type=Path, help="PNG file: error against run time, alone")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    asked = parser.parse_args()
    missing = [one for one in asked.simulators if not find_spec(one)]
    used = [one for one in asked.simulators if one not in missing]
    quiet()
    if asked.plot:
        found = work_precision(used, asked.turns)
        asked.plot.write_bytes(png(plot_of(found, asked.turns)))
        print(json.dumps({**machine(), "turns": asked.turns, "simulators": found}, indent=1))
        return
    results = {sheet: results_of(asked, used, sheet) for sheet in asked.sheets}
    if asked.json:
        print(json.dumps({"missing": missing, "sheets": results}))
        return
    for one in missing:
        print(f"{one} is not installed; pip install '.[peers]' installs it.")
    for sheet, found in results.items():
        print("\n".join(table(sheet, found)), end="\n\n")


if __name__ == "__main__":
    main()
