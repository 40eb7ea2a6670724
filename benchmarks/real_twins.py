"""Twins of real cameras: fitted to half of the frames of an EMVA 1288 reference set, beside the other half.

    python benchmarks/real_twins.py EMVA1288_ReferenceSet_002_CMOS_08Bit/EMVA1288_Data.txt [--plot twin.png] [--json]

The data sets are public (github.com/EMVA1288/datasets, CC BY-SA). Every second level of the flat fields and of the dark
frames is fitted, and every second frame of a stack of 8 or more; the twin then takes frames at the light of the others,
as another chip of the same kind. Compared are temporal variances at equal means, by the twin's own curve. In the dark
the variance of coarse codes depends on the black level, which jitters: beside the twin stands how far the two halves of
the real frames are apart.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.bench import Bench, read_bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.frames.temporal import temporal
from mitsuba_sensor.lab.measure.line_noise import line_noise
from mitsuba_sensor.lab.twin import Twin, fit

FEWEST = 8
"""Frames of a stack of which every second is fitted."""
CLIPPED = 1e-3
"""Share of the largest code from which on a level is behind the clip."""
LEVELS = np.concatenate(
    [
        [0, 2e-4, 5e-4],
        np.linspace(0.004, 0.05, 6),
        np.linspace(0.07, 0.8, 30),
        np.linspace(0.83, 1.3, 20),
    ]
)
"""Light of the twin's curve, over that of the end of its range."""
SIZE = (128, 512)
"""Rows and columns of the twin's frames."""
Values = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """Photon transfer: mean [DN], temporal variance of a pixel [DN²], and share of values at the largest code."""

    mean: Values
    variance: Values
    clipped: Values

    @classmethod
    def of(cls, stacks: Sequence[Stack]) -> Curve:
        """Of flat fields."""
        measured = [temporal(stack) for stack in stacks]
        largest = [2 ** (stack.bits or 16) - 1 for stack in stacks]
        clipped = [
            float((stack.frames >= top).mean())
            for stack, top in zip(stacks, largest, strict=True)
        ]
        means = np.array([one.mean for one in measured])
        order = np.argsort(means)
        variances = np.array([one.variance for one in measured])
        return cls(means[order], variances[order], np.array(clipped)[order])


def halves(bench: Bench) -> tuple[Bench, Bench]:
    """The frames that are fitted, and those that are held out."""
    parts = []
    for first in (0, 1):
        darks, flats = (_half(stacks, first) for stacks in (bench.darks, bench.flats))
        parts.append(replace(bench, darks=darks, flats=flats))
    return parts[0], parts[1]


def _half(stacks: Sequence[Stack], first: int) -> tuple[Stack, ...]:
    """Every second stack of few frames, and every second frame of the others."""
    ordered = sorted(stacks, key=lambda stack: stack.exposure_s)
    few = [stack for stack in ordered if len(stack) < FEWEST]
    many = [
        replace(stack, frames=stack.frames[first::2]) for stack in ordered if stack not in few
    ]
    return (*few[first::2], *many)


def camera_of(twin: Twin) -> ms.Camera:
    """The twin, as large as the frames that it takes."""
    size = {"sensor.rows": SIZE[0], "sensor.columns": SIZE[1]}
    return ms.load_camera(twin.tables()).replace(**size)


def twin_curve(twin: Twin, camera: ms.Camera, exposure_s: float) -> Curve:
    """Frames of the twin from near darkness to saturation."""
    base = twin.base
    end_e = base.electrons(base.brightest.end).quantity.value
    photons_per_e = 1 / float(camera.qe([550.0]).max())
    stacks = []
    for number, level in enumerate(LEVELS):
        light = np.full(SIZE, level * end_e * photons_per_e)
        with warnings.catch_warnings(action="ignore", category=ms.SensorWarning):
            taken = ms.expose(light, camera, ms.Exposure(exposure_s), frames=4, seed=number)
        stacks.append(Stack(taken.digital, exposure_s, bits=camera.adc.bits))
    return Curve.of(stacks)


def dark_figures(stack: Stack) -> dict[str, float]:
    """Mean, temporal and spatial variance, and what rows, columns and frames share [DN, DN²]."""
    lines = line_noise(stack)
    variance = float(stack.variance.mean())
    return {
        "mean_dn": float(stack.frame_means.mean()),
        "temporal_dn2": variance,
        "spatial_dn2": float(stack.mean.var()) - variance / len(stack),
        "row_dn": lines.row.value,
        "column_dn": lines.column.value,
        "frame_dn": float(stack.frame_means.std(ddof=1)),
    }


def compare(path: str) -> dict[str, Any]:
    """Fit, frames of the twin, and both beside each other."""
    kept, held = halves(read_bench(path))
    twin = fit(kept, progress=False)
    camera = camera_of(twin)
    dark, kept_dark = (max(bench.darks, key=len) for bench in (held, kept))
    made = ms.expose(np.zeros(SIZE), camera, ms.Exposure(dark.exposure_s), frames=200, seed=77)
    twin_dark = Stack(made.digital, dark.exposure_s, bits=camera.adc.bits)
    real = Curve.of([flat for flat in held.flats if len(flat) < FEWEST])
    curve = twin_curve(twin, camera, dark.exposure_s)
    return {
        "camera": Path(path).parent.name,
        "figures": {name: str(one.quantity) for name, one in twin.figures().items()},
        "dark": {
            "real": dark_figures(dark),
            "twin": dark_figures(twin_dark),
            "other half": dark_figures(kept_dark),
        },
        "transfer": _beside(real, curve),
        "twin_curve": {"mean_dn": list(curve.mean), "variance_dn2": list(curve.variance)},
    }


def _beside(real: Curve, twin: Curve) -> list[dict[str, float]]:
    """Variance of the twin at the means of the real levels, and by how much it is off [%]."""
    rows = []
    for mean, variance, clipped in zip(real.mean, real.variance, real.clipped, strict=True):
        expected = float(np.interp(mean, twin.mean, twin.variance))
        off = float("nan")
        if variance > 0:
            off = 100 * (expected / variance - 1)
        rows.append(
            {
                "mean_dn": float(mean),
                "real_dn2": float(variance),
                "twin_dn2": expected,
                "off_percent": off,
                "clipped": float(clipped),
            }
        )
    return rows


def report(result: dict[str, Any]) -> str:
    """Text of a comparison."""
    lines = [result["camera"], *map(str, result["figures"].values()), ""]
    lines.append(
        f"{'dark':14}{'real':>10}{'twin':>10}{'off %':>8}{'other half':>12}{'off %':>8}"
    )
    dark = result["dark"]
    for name, value in dark["real"].items():
        if not value > 0:
            continue  # hidden by rounding, or none
        made, other = dark["twin"][name], dark["other half"][name]
        off = [100 * (one / value - 1) for one in (made, other)]
        lines.append(
            f"{name:14}{value:10.4f}{made:10.4f}{off[0]:8.1f}{other:12.4f}{off[1]:8.1f}"
        )
    rows = result["transfer"]
    inside = [row for row in rows if row["clipped"] < CLIPPED]
    off = np.abs([row["off_percent"] for row in inside])
    worst = inside[int(np.argmax(off))]
    lines += [
        "",
        f"photon transfer, {len(inside)} held-out levels below the clip: off by {np.median(off):.2f} % (median), "
        f"{worst['off_percent']:.1f} % at most, at {worst['mean_dn']:.4g} DN; "
        f"{100 * np.mean(off < 3):.0f} % of the levels are within 3 %",
    ]
    for row in rows:
        if row["real_dn2"] > 0.02 * max(one["real_dn2"] for one in rows):
            lines.append(
                f"  {row['mean_dn']:8.2f} DN  real {row['real_dn2']:9.3f}  twin {row['twin_dn2']:9.3f} DN²"
                f"  {row['off_percent']:6.1f} %  clipped {100 * row['clipped']:.2g} %"
            )
    return "\n".join(lines)


def plot(result: dict[str, Any], path: str) -> None:
    """Photon transfer of the held-out levels and of the twin."""
    from matplotlib import pyplot

    figure, (curve, off) = pyplot.subplots(
        2, 1, figsize=(7, 6), sharex=True, height_ratios=(3, 1), layout="constrained"
    )
    rows, twin = result["transfer"], result["twin_curve"]
    means = [row["mean_dn"] for row in rows]
    curve.plot(twin["mean_dn"], twin["variance_dn2"], "-", color="tab:blue", label="twin")
    curve.plot(means, [row["real_dn2"] for row in rows], "k.", label="camera, held-out levels")
    curve.set(ylabel="temporal variance [DN²]", title=result["camera"])
    curve.legend()
    inside = [row for row in rows if row["clipped"] < CLIPPED]
    off.axhspan(-3, 3, color="0.9")
    off.plot(
        [row["mean_dn"] for row in inside],
        [row["off_percent"] for row in inside],
        ".",
        color="k",
    )
    off.set(xlabel="mean [DN]", ylabel="twin off [%]", ylim=(-10, 10))
    figure.savefig(path, dpi=110)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("descriptor", help="EMVA1288_Data.txt of a reference set")
    parser.add_argument("--plot", help="picture of the photon transfer")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    arguments = parser.parse_args()
    result = compare(arguments.descriptor)
    if arguments.plot:
        plot(result, arguments.plot)
    print(json.dumps(result) if arguments.json else report(result))


if __name__ == "__main__":
    main()
