"""The figures of lab.emva_linear beside those of emva1288 and getframes, in frames of random linear cameras.

    pip install '.[peers]' && python benchmarks/lab_peers.py [--cameras 20] [--pixels 128] [--json]

Every camera has 0.42 DN or more of temporal dark noise. What it is compared with: K and QE of its data sheet; the dark
noise of the theory in darkness; as saturation the light at which the theory's temporal variance, averaged over the same
pixels, is largest; no linearity error. Ours and emva1288 see the same two frames of each level, as EMVA 1288 asks;
getframes, which takes medians over the pixels of variances over the frames, sees 16. It gives no QE.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.emva_linear import emva_linear
from mitsuba_sensor.stages.gains import gain_dn_per_e

Figures = dict[str, float]
LIMITS = {"K": 1.0, "QE": 1.0, "sigma_d": 2.0, "saturation": 1.0, "linearity": 0.05}
"""Largest errors [%]."""
EXPOSURE = ms.Exposure(0.001)
LEVELS = np.concatenate([np.linspace(0.02, 0.9, 45), np.linspace(0.905, 1.05, 30)])
"""Of the light that fills the range: EMVA 1288 R4 6.5 asks for 50 or more; these are dense where it saturates."""


@dataclass(frozen=True)
class Bench:
    """A camera, its true figures, and frames (16, H, W) of each level of light [photons per pixel], dark ones first."""

    camera: ms.Camera
    true: Figures
    light: NDArray[np.float64]
    frames: list[NDArray[np.integer[Any]]]


def bench(number: int, side: int) -> Bench:
    """The same for the same number."""
    chance = np.random.default_rng([1288, number])
    base = ms.load_camera("konnik_table1")
    well, bits = (
        float(np.exp(chance.uniform(*np.log((5e3, 5e4))))),
        int(chance.choice([10, 12, 14])),
    )
    swing, efficiency = well * 5e-6 * chance.uniform(0.9, 1.3), float(chance.uniform(0.3, 0.9))
    fields = {
        "pixel.full_well_e": well,
        "pixel.prnu": float(chance.uniform(0, 0.01)),
        "adc.bits": bits,
        "adc.full_scale_v": swing,
        "quantum_efficiency.curves": {"mono": [efficiency, efficiency]},
        "readout.dsnu_col": float(chance.uniform(0, 1e-3)),
    }
    camera = base.replace(**fields)
    gain = gain_dn_per_e(camera)
    noise_e = 0.42 / gain * chance.uniform(1, 8)
    unit = _theory(
        camera, 0.0, side
    )  # proportional to the white noise but for the dark current
    white = 15.0 * noise_e / math.sqrt(max(float(unit.mean()) - 1 / 12, 1e-12)) * gain
    black = 10 + 10 * gain * noise_e
    camera = camera.replace(
        **{"source_follower.white_nv_per_rthz": white, "adc.black_level_dn": black}
    )
    top = min(well, (2**bits - 1 - black) / gain) / efficiency
    light = np.concatenate([[0.0], LEVELS * top])
    ends = 0.85 * top, 1.05 * top
    missing = minimize_scalar(
        lambda x: -float(_theory(camera, x, side).mean()),
        bounds=ends,
        options={"xatol": 1e-3 * top},
    )
    dark = math.sqrt(float(_theory(camera, 0.0, side).mean()) - 1 / 12) / gain
    frames = [
        ms.expose(np.full((side, side), one), camera, EXPOSURE, frames=16, seed=i)
        for i, one in enumerate(light)
    ]
    true = {
        "K": gain,
        "QE": efficiency,
        "sigma_d": dark,
        "saturation": float(missing.x),
        "linearity": 0.0,
    }
    return Bench(camera, true, light, [one.digital for one in frames])


def _theory(camera: ms.Camera, photons: float, side: int) -> NDArray[np.float32]:
    return ms.expose(np.full((side, side), photons), camera, EXPOSURE).temporal_variance


def ours(series: Bench) -> Figures:
    """Of lab.emva_linear."""
    stacks = [
        Stack(frames[:2], EXPOSURE.time_s, photons=float(photons), bits=series.camera.adc.bits)
        for frames, photons in zip(series.frames, series.light, strict=True)
    ]
    found = emva_linear(stacks[:1], stacks[1:])
    names = {"K": "K", "QE": "η", "sigma_d": "σ_d", "saturation": "µ_p.sat", "linearity": "LE"}
    return {name: found[symbol].value for name, symbol in names.items()}


def of_emva1288(series: Bench) -> Figures:
    """Of the package of the standard's authors, which asks for a function that NumPy 2 has no more."""
    np.asfarray = lambda values, dtype=float: np.asarray(values, dtype)  # type: ignore[attr-defined]
    from emva1288.process.data import Data1288
    from emva1288.process.results import Results1288
    from emva1288.process.routines import get_int_imgs

    images = [get_int_imgs(list(frames[:2])) for frames in series.frames]
    sums = [
        {name: one[name].sum() for name in ("sum", "pvar")} | {"dmean": one["dmean"]}
        for one in images
    ]
    time, middle = EXPOSURE.time_s, len(images) // 2
    given = {
        "temporal": {time: dict(zip(series.light.tolist(), sums, strict=True))},
        "spatial": {time: {0.0: images[0], float(series.light[middle]): images[middle]}},
        "height": series.frames[0].shape[1],
        "width": series.frames[0].shape[2],
    }
    found = Results1288(Data1288(given).data, loglevel=50)
    linearity = found.linearity()
    inside = slice(found.index_linearity_min, found.index_linearity_max + 1)
    return {
        "K": found.K,
        "QE": found.QE / 100,
        "sigma_d": found.sigma_d,
        "saturation": found.u_p_sat,
        "linearity": float(np.mean(np.abs(linearity["relative_deviation"][inside]))),
    }


def of_getframes(series: Bench) -> Figures:
    """Of characterize_flat; read noise comes from its faintest level, saturation as photons by the true QE."""
    from getframes.analysis.characterize import characterize_flat, stack_statistics

    black = float(series.frames[0].mean())
    stacks = {
        float(x): stack_statistics(one)
        for x, one in zip(series.light[1:], series.frames[1:], strict=True)
    }
    found = characterize_flat(stacks, bias_adu=black)
    full = math.nan if found.full_well_e is None else found.full_well_e / series.true["QE"]
    return {"K": 1 / found.gain_e_per_adu, "sigma_d": found.read_noise_e, "saturation": full}


PACKAGES: dict[str, Callable[[Bench], Figures]] = {
    "ours": ours,
    "emva1288": of_emva1288,
    "getframes": of_getframes,
}


def compared(count: int, side: int) -> dict[str, Any]:
    """Errors [%] of every package and figure, over all cameras: root mean square and the largest; missing packages."""
    errors: dict[str, dict[str, list[float]]] = {name: {} for name in PACKAGES}
    missing: dict[str, str] = {}
    for number in range(count):
        series = bench(number, side)
        for name, measure in PACKAGES.items():
            try:
                found = measure(series)
            except ModuleNotFoundError as error:
                missing[name] = f"pip install '.[peers]' ({error})"
                continue
            for figure, value in found.items():
                true = series.true[figure]
                error_percent = (
                    abs(value) if figure == "linearity" else 100 * abs(value / true - 1)
                )
                errors[name].setdefault(figure, []).append(error_percent)
    summary = {
        name: {
            figure: {
                "rms": float(np.sqrt(np.mean(np.square(one)))),
                "largest": float(np.max(one)),
            }
            for figure, one in of.items()
        }
        for name, of in errors.items()
    }
    return {
        "cameras": count,
        "pixels": side**2,
        "limits": LIMITS,
        "errors": summary,
        "missing": missing,
    }


def table(found: dict[str, Any]) -> str:
    """One row per figure."""
    packages = [name for name, of in found["errors"].items() if of]
    lines = [
        f"{found['cameras']} cameras, {found['pixels']} pixels, errors [%]: root mean square (largest)"
    ]
    lines += [f"{'':12}{'limit':>8}" + "".join(f"{name:>20}" for name in packages)]
    for figure, limit in LIMITS.items():
        cells = [found["errors"][name].get(figure) for name in packages]
        shown = [f"{one['rms']:.3f} ({one['largest']:.3f})" if one else "none" for one in cells]
        lines.append(f"{figure:12}{limit:8.2f}" + "".join(f"{one:>20}" for one in shown))
    return "\n".join([*lines, *(f"{name}: {why}" for name, why in found["missing"].items())])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cameras", type=int, default=20)
    parser.add_argument("--pixels", type=int, default=128, help="rows, and as many columns")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    result = compared(asked.cameras, asked.pixels)
    print(json.dumps(result) if asked.json else table(result))
