"""Measure raw and denoised renders against long references: errors, bias, error bars, CPU seconds.

    python benchmarks/denoise.py [--scenes FILE.xml …] [--spp 64 128 512 2048] [--width 96] [--seeds 4]

Each scene is rendered at 550 nm, exposed so that the median pixel has 1500 photoelectrons. Squared error over the
electrons of the reference is the noise ratio of a camera without read noise: 1 is a render as noisy as the light.
median, mean, 95 % : of that ratio, over all pixels below the full well and seeds; the reference's own noise is in it.
capped : its mean, where no pixel counts for more than the 95th percentile of the raw render.
bias : of the sum over the pixels below the full well.  z1, z2 : pixels within one and two standard errors, those of
the reference included.
equal time : median, mean, 95 % and capped mean of the raw render, scaled to the CPU seconds of the other one, over the
other one's. Loading and compiling are not timed, because all have them.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from timing import lines

import mitsuba_sensor as ms
from mitsuba_sensor.render.light.photons import mean_electrons
from mitsuba_sensor.render.passes.prepared import PreparedRender, prepare
from mitsuba_sensor.render.passes.stop_criterion import stop_criterion_of
from mitsuba_sensor.render.samples import hashed_seed

Array = NDArray[np.float64]
Row = dict[str, Any]

SCENES = Path(__file__).parent.parent / "scenes"
SHIPPED = ("cornell_box", "still_life", "color_checker", "caustic")
CAMERA = ms.load_camera("konnik_table1")
MEDIAN_E = 1500.0
PILOT_SPP = 64
KINDS: dict[str, dict[str, bool]] = {
    "raw": {"denoise": False},
    "denoised": {"denoise": True},
}
FIGURES = ("median", "mean", "p95", "capped")


class Made(NamedTuple):
    """CPU seconds, mean photoelectrons and their standard error, (H, W), of a render."""

    seconds: float
    mean: Array
    sigma: Array
    is_denoised: bool


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--scenes", type=Path, nargs="+", default=[SCENES / f"{name}.xml" for name in SHIPPED]
    )
    parser.add_argument("--spp", type=int, nargs="+", default=[64, 128, 512, 2048])
    parser.add_argument("--width", type=int, default=96, help="columns of the pictures")
    parser.add_argument(
        "--reference", type=int, default=16384, help="samples per pixel of the reference"
    )
    parser.add_argument("--seeds", type=int, default=4, help="renders of each kind")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    rows = [row for scene in options.scenes for row in of_scene(scene, options)]
    print(json.dumps(rows) if options.json else "\n".join(lines(rows)))


def of_scene(scene: Path, options: argparse.Namespace) -> list[Row]:
    """Return one row for each number of samples."""
    asked = {"wavelength_nm": 550, "width": options.width}
    job = prepare(scene, CAMERA, ms.Exposure(1.0), **asked)
    _, pilot, *_ = made(job, PILOT_SPP, 0, denoise=False)
    time_s = MEDIAN_E / float(np.median(pilot))
    job = replace(job, exposure=ms.Exposure(time_s))
    expected = made(job, options.reference, 10**6, denoise=False)[1:3]
    rows = []
    for spp in options.spp:
        row: Row = {"scene": scene.stem, "spp": spp}
        most = None
        for kind, decided in KINDS.items():
            made(job, spp, 99, **decided)  # compiles
            found = [made(job, spp, seed, **decided) for seed in range(options.seeds)]
            row[kind] = errors(found, *expected, most)
            most = row["raw"]["p95"]
        for kind in KINDS:
            longer = row[kind]["seconds"] / row["raw"]["seconds"]
            row[kind]["equal_time"] = [
                row["raw"][x] / longer / max(row[kind][x], 1e-30) for x in FIGURES
            ]
        rows.append(row)
    return rows


def made(job: PreparedRender, spp: int, seed: int, denoise: bool) -> Made:
    """Render once, with or without denoising."""
    started = time.process_time()
    decided = replace(job, options={**job.options, "denoise": denoise})
    light = decided.render(hashed_seed(seed, spp, 0), stop_criterion_of({"spp": spp}))
    seconds = time.process_time() - started
    mean = mean_electrons(light, job.camera, job.exposure)
    return Made(
        seconds, mean, light.relative_error * mean, light.statistics.denoised is not None
    )


def errors(
    found: list[Made], expected: Array, uncertainty: Array, most: float | None = None
) -> dict[str, float]:
    """Figures of renders against a reference with standard errors of its own.  most : ratio that a pixel counts for at
    most; None: the 95th percentile."""
    below = (expected > 0) & (expected < CAMERA.pixel.full_well_e)
    reference = expected[below]
    apart = [np.abs(mean[below] - reference) for _, mean, *_ in found]
    ratio = np.concatenate([x**2 / reference for x in apart])
    sigmas = [
        np.maximum(np.hypot(sigma, uncertainty)[below], 1e-12 * reference)
        for _, _, sigma, _ in found
    ]
    p95 = float(np.percentile(ratio, 95))
    z = np.concatenate([x / sigma for x, sigma in zip(apart, sigmas, strict=True)])
    return {
        "median": float(np.median(ratio)),
        "mean": float(ratio.mean()),
        "p95": p95,
        "capped": float(np.minimum(ratio, p95 if most is None else most).mean()),
        "bias": float(
            np.mean([mean[below].sum() / reference.sum() - 1 for _, mean, *_ in found])
        ),
        "z1": float((z < 1).mean()),
        "z2": float((z < 2).mean()),
        "seconds": float(np.median([seconds for seconds, *_ in found])),
        "denoised": float(np.mean([one.is_denoised for one in found])),
    }


if __name__ == "__main__":
    main()
