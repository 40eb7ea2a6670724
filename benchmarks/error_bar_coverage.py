"""Measure the coverage of the standard errors of a render, with a reference of a hundred times the samples.

    python benchmarks/error_bar_coverage.py --size 32          # a table of three scenes (10 minutes)
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
    """Return ∫L dλ over the band by plain Mitsuba, shape (size, size) [W m⁻² sr⁻¹]."""
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
    """Return the fractions of pixels with |z| < 1 and |z| < 2 for a reference radiance, and the render."""
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


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, help="only write the reference to this .npz")
    parser.add_argument("--size", type=int, default=SIZE, help="width and height [pixels]")
    parser.add_argument("--quick", action="store_true", help="a small reference, for a test")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.write:
        radiance = reference("cornell_box", PASSES, SIZE).astype(np.float32)
        np.savez_compressed(options.write, radiance=radiance)
        return
    size, passes = (12, 4) if options.quick else (options.size, PASSES)
    rows = []
    for scene in SCENES:
        radiance = reference(scene, passes, size)
        for spp in (64, 128, 240, 1152):
            z1, z2, light = coverage(scene, spp, radiance)
            fireflies = light.statistics.firefly_fraction
            row = {
                "scene": scene,
                "spp": spp,
                "z1": z1,
                "z2": z2,
                "firefly_fraction": fireflies,
            }
            rows.append(row | {"reliable": light.statistics.reliable})
    print(json.dumps(rows) if options.json else "\n".join(lines(rows)))


if __name__ == "__main__":
    main()
