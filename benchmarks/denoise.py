"""Measure denoised and raw renders against long references: errors over shot noise, bias, error bars, seconds.

    python benchmarks/denoise.py [--scenes FILE.xml …] [--spp 64 128 512 2048] [--width 96] [--seeds 4] [--rays 64]
        [--references FOLDER]

Each scene is rendered at 550 nm, exposed so that the median pixel has 1500 photoelectrons. Squared error over the
electrons of the reference is the noise ratio of a camera without read noise: 1 is a render as noisy as the light.
median, mean, 95 % : of that ratio, over all pixels below the full well and seeds; the reference's own noise is in it.
bias : of the sum over the pixels below the full well.  z1, z2 : pixels within one and two standard errors, those of
the reference included.
equal time : the raw render's ratio, scaled to the seconds of the denoised one, over the denoised one's. Loading and
compiling are not timed, because both have them.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.render.denoise import guides
from mitsuba_sensor.render.passes.passes import hashed_seed
from mitsuba_sensor.render.passes.prepared import PreparedRender, prepare
from mitsuba_sensor.render.passes.renderer import Renderer
from mitsuba_sensor.render.passes.row_strip import Kept
from mitsuba_sensor.render.passes.stop_criterion import stop_criterion_of

Array = NDArray[np.float64]
Row = dict[str, Any]

SCENES = Path(__file__).parent.parent / "scenes"
SHIPPED = ("cornell_box", "still_life", "color_checker", "caustic")
CAMERA = ms.load_camera("konnik_table1")
MEDIAN_E = 1500.0
PILOT_SPP = 64


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
    parser.add_argument(
        "--rays",
        type=int,
        help="of the guides, per pixel, a power of two from 2; by default as needed",
    )
    parser.add_argument(
        "--references",
        type=Path,
        help="folder that keeps the references from one run to the next",
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.rays:
        guides.FEWEST_RAYS = guides.MOST_RAYS = options.rays
    rows = [row for scene in options.scenes for row in of_scene(scene, options)]
    if options.json:
        print(json.dumps(rows))
        return
    for row in rows:
        print(
            f"{row['scene']}, {row['spp']} samples; equal time: {', '.join(f'{x:.3g}' for x in row['equal_time'])}"
        )
        for kind in ("raw", "denoised"):
            one = row[kind]
            found = ", ".join(
                f"{name} {one[name]:.4g}"
                for name in ("median", "mean", "p95", "bias", "z1", "z2")
            )
            print(f"    {kind:9s}{found}, {one['seconds']:.2f} s")


def of_scene(scene: Path, options: argparse.Namespace) -> list[Row]:
    """One row for each number of samples."""
    asked = {"wavelength_nm": 550, "width": options.width}
    job = prepare(scene, CAMERA, ms.Exposure(1.0), **asked)
    _, pilot, _ = made(job, PILOT_SPP, 0, denoise=False)
    time_s = MEDIAN_E / float(np.median(pilot))
    job = replace(job, exposure=ms.Exposure(time_s))
    expected = reference(job, scene, options)
    rows = []
    for spp in options.spp:
        row: Row = {"scene": scene.stem, "spp": spp}
        for kind in ("raw", "denoised"):
            made(job, spp, 99, kind == "denoised")  # compiles
            found = [made(job, spp, seed, kind == "denoised") for seed in range(options.seeds)]
            row[kind] = errors(found, *expected)
        longer = row["denoised"]["seconds"] / row["raw"]["seconds"]
        row["equal_time"] = [
            row["raw"][x] / longer / max(row["denoised"][x], 1e-30)
            for x in ("median", "mean", "p95")
        ]
        rows.append(row)
    return rows


def reference(job: PreparedRender, scene: Path, options: argparse.Namespace) -> list[Array]:
    """Mean and standard error of the long render; from its file where that is there."""
    if options.references is None:
        return list(made(job, options.reference, 10**6, denoise=False)[1:])
    options.references.mkdir(parents=True, exist_ok=True)
    name = f"{scene.stem}-{job.scene.sha256[:8]}-{options.width}-{options.reference}-{job.exposure.time_s:.6g}.npy"
    if not (file := options.references / name).exists():
        np.save(file, np.stack(made(job, options.reference, 10**6, denoise=False)[1:]))
    return list(np.load(file))


def made(job: PreparedRender, spp: int, seed: int, denoise: bool) -> tuple[float, Array, Array]:
    """Seconds, mean photoelectrons and their standard error, (H, W), of one render."""
    renderer = Renderer(
        job.scene, job.camera, job.exposure, job.bands, Kept.of(denoise, raw_light=True)
    )
    started = time.perf_counter()
    replace(job, renderer=renderer, denoise=denoise).render(
        hashed_seed(seed, spp, 0), stop_criterion_of({"spp": spp})
    )
    mean, variance = renderer.electrons()
    return time.perf_counter() - started, mean, np.sqrt(variance)


def errors(
    found: list[tuple[float, Array, Array]], expected: Array, uncertainty: Array
) -> dict[str, float]:
    """Figures of renders against a reference with standard errors of its own."""
    below = (expected > 0) & (expected < CAMERA.pixel.full_well_e)
    reference = expected[below]
    apart = [np.abs(mean[below] - reference) for _, mean, _ in found]
    ratio = np.concatenate([x**2 / reference for x in apart])
    sigmas = [
        np.maximum(np.hypot(sigma, uncertainty)[below], 1e-12 * reference)
        for _, _, sigma in found
    ]
    z = np.concatenate([x / sigma for x, sigma in zip(apart, sigmas, strict=True)])
    return {
        "median": float(np.median(ratio)),
        "mean": float(ratio.mean()),
        "p95": float(np.percentile(ratio, 95)),
        "bias": float(
            np.mean([mean[below].sum() / reference.sum() - 1 for _, mean, _ in found])
        ),
        "z1": float((z < 1).mean()),
        "z2": float((z < 2).mean()),
        "seconds": float(np.median([seconds for seconds, _, _ in found])),
    }


if __name__ == "__main__":
    main()
