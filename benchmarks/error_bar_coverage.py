"""Measure the coverage of the standard errors of a render, with a reference of a hundred times the samples.

    python benchmarks/error_bar_coverage.py --size 32          # a table of three scenes (10 minutes)
    python benchmarks/error_bar_coverage.py --bands            # single bands, with and without denoising (2 minutes)
    python benchmarks/error_bar_coverage.py --write FILE.npz   # the reference in tests/data (10 minutes)

The reference is plain Mitsuba with its own film and sampler: passes of 1024 samples, summed in float64.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from plain_mitsuba import sensor_like
from timing import lines

import mitsuba_sensor as ms
from mitsuba_sensor.optics.f_number_law import solid_angle_sr
from mitsuba_sensor.render.light.bands import choose_bands
from mitsuba_sensor.render.load.scene import load_scene
from mitsuba_sensor.render.variants import choose_variant, use

ROOT = Path(__file__).parent.parent
SIZE, BAND_NM = 64, (545.0, 555.0)
PASSES = 114  # of 1024 samples: more than a hundred times 1152
SCENES = ("cornell_box", "still_life", "caustic")
CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.02)


def reference(scene: str, passes: int, size: int) -> np.ndarray:
    """∫L dλ over the band by plain Mitsuba, (size, size) [W m⁻² sr⁻¹]."""
    mi = use(choose_variant())
    loaded = mi.load_file(
        str(ROOT / "scenes" / f"{scene}.xml"), width=str(size), height=str(size)
    )
    sensor = sensor_like(mi, loaded.sensors()[0], size, BAND_NM)
    total = np.zeros((size, size))
    for k in range(passes):
        image = loaded.integrator().render(loaded, sensor=sensor, seed=1_000_000 + k, spp=1024)
        total += np.array(image, dtype=np.float64).reshape(size, size)
    return total / passes


def coverage(
    scene: str, spp: int, radiance: np.ndarray, seed: int = 7
) -> tuple[float, float, ms.Irradiance]:
    """Fractions of the pixels with |z| < 1 and < 2 for a reference radiance, and the render."""
    path, size = (
        ROOT / "scenes" / f"{scene}.xml",
        {"width": len(radiance), "height": len(radiance)},
    )
    light = ms.render(
        path,
        CAMERA,
        EXPOSURE,
        spp=spp,
        wavelength_nm=550,
        seed=seed,
        parameters=size,
        denoise=False,
    )
    view = load_scene(path, choose_bands(CAMERA, 550.0, 10.0, "auto"), size).view
    expected = (
        radiance
        * solid_angle_sr(view, CAMERA)
        * CAMERA.lens.transmission
        / (BAND_NM[1] - BAND_NM[0])
    )
    error = light.standard_error[..., 0].astype(float)
    z = np.abs(light.data[..., 0] - expected)[error > 0] / error[error > 0]
    return float((z < 1).mean()), float((z < 2).mean()), light


def of_bands(
    scene: str, spp: int, expected: np.ndarray | None, denoise: bool
) -> tuple[float, float, np.ndarray]:
    """Fractions of pixels and bands of 20 nm with |z| < 1 and < 2 for an expected irradiance, and the irradiance."""
    options = {
        "spp": spp,
        "width": 48,
        "bandwidth_nm": 20,
        "denoise": denoise,
        "seed": 7 if expected is None else 8,
    }
    light = ms.render(ROOT / "scenes" / f"{scene}.xml", CAMERA, EXPOSURE, **options)
    found, error = light.data.astype(float), light.standard_error.astype(float)
    z = (np.abs(found - (found if expected is None else expected)) / np.maximum(error, 1e-30))[
        error > 0
    ]
    return float((z < 1).mean()), float((z < 2).mean()), found


def bands(quick: bool) -> list[dict[str, object]]:
    """A row for each scene, number of samples and kind of light; the reference has 8192 samples."""
    rows = []
    for scene in SCENES[:1] if quick else SCENES[:2]:
        expected = of_bands(scene, 64 if quick else 8192, None, False)[2]
        for spp in (64,) if quick else (64, 240):
            for denoise in (False, True):
                one, two, _ = of_bands(scene, spp, expected, denoise)
                rows.append(
                    {"scene": scene, "spp": spp, "denoised": denoise, "z1": one, "z2": two}
                )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--write",
        type=Path,
        help="write the reference of the Cornell box into this .npz and stop",
    )
    parser.add_argument(
        "--size", type=int, default=SIZE, help="width and height of the renders in pixels"
    )
    parser.add_argument(
        "--bands", action="store_true", help="single bands instead, with and without denoising"
    )
    parser.add_argument(
        "--quick", action="store_true", help="a small reference: a check of the script"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.write:
        np.savez_compressed(
            options.write, radiance=reference("cornell_box", PASSES, SIZE).astype(np.float32)
        )
        return
    if options.bands:
        rows = bands(options.quick)
        print(json.dumps(rows) if options.json else "\n".join(lines(rows)))
        return
    size, passes = (12, 4) if options.quick else (options.size, PASSES)
    rows = []
    for scene in SCENES:
        radiance = reference(scene, passes, size)
        for spp in (64, 128, 240, 1152):
            one, two, light = coverage(scene, spp, radiance)
            fraction, reliable = light.statistics.firefly_fraction, light.statistics.reliable
            rows.append(
                {
                    "scene": scene,
                    "spp": spp,
                    "z1": one,
                    "z2": two,
                    "firefly_fraction": fraction,
                    "reliable": reliable,
                }
            )
    if options.json:
        print(json.dumps(rows))
        return
    print(
        f"{'scene':<14}{'samples':>8}{'|z| < 1':>9}{'|z| < 2':>9}{'firefly fraction':>18}  reliable"
    )
    for row in rows:
        print(
            "{scene:<14}{spp:>8}{z1:>9.3f}{z2:>9.3f}{firefly_fraction:>18.4f}  {reliable}".format(
                **row
            )
        )


if __name__ == "__main__":
    main()
