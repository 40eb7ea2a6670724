"""Measure the time of a render with distortion or a sequential lens, compared with the thin lens of Mitsuba.

    python benchmarks/lens_cost.py [--size 256] [--samples 16] [--turns 7] [--quick] [--json]

The still life, one band, equal samples, field of view, focus and pupil: with the thin lens of the scene, with the
distortion of a wide-angle lens in addition, with a double Gauss lens of eleven surfaces, and with its dispersion. One
pass is timed in llvm_ad_spectral. The lenses run alternately; the first turn, in which kernels are compiled, is not
counted. The ratio must be below 1.1.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from timing import alternate, lines, ratio

from mitsuba_sensor.core.versions import machine
from mitsuba_sensor.optics.paraxial import cardinal_points
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.scene.scene import Scene, load_scene
from mitsuba_sensor.render.variants import choose_variant, use
from mitsuba_sensor.sensor.camera import Camera
from mitsuba_sensor.sensor.camera_file import load_camera

SCENE = Path(__file__).resolve().parent.parent / "scenes" / "still_life.xml"
VARIANT = "llvm_ad_spectral"
FOCUS_M = 0.1
"""Default focus distance of the still life."""
F_NUMBER = 5.6
"""The double Gauss has almost no vignetting here; blocked rays would take less time."""
DISTORTION = [-0.2, 0.05, 0.001, -0.001, 0.0]
"""k1, k2, p1, p2, k3: the barrel distortion of a common wide-angle lens."""


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=256, help="width and height in pixels (default 256)")
    parser.add_argument("--samples", type=int, default=16, help="samples per pixel of a pass (default 16)")
    parser.add_argument("--turns", type=int, default=7, help="passes through each lens (default 7)")
    parser.add_argument("--quick", action="store_true", help="a very small picture: a check of the script")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.quick:
        options.size, options.samples, options.turns = 16, 4, 1
    use(choose_variant(VARIANT))
    seconds = alternate({name: one_pass(scene, options) for name, scene in scenes(options.size).items()}, options.turns)
    found = {
        name: {"seconds": statistics.median(those), "ratio_to_thin_lens": ratio(those, seconds["thin_lens"])}
        for name, those in seconds.items()
    }
    results = {**machine(), "samples": options.size**2 * options.samples, "turns": options.turns, "lenses": found}
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def scenes(size: int) -> dict[str, Scene]:
    """The still life with every lens, with the field of view of the scene."""
    thin = load_camera("konnik_table1").replace(**{"lens.f_number": F_NUMBER})
    bands = box_bands(thin, np.array([545.0, 555.0]))
    half_width = load_scene(SCENE, bands, {"width": size, "height": size}, thin).view.half_width
    real = double_gauss(thin, 0.5e-3 * size * thin.pixel.pitch_x_um / half_width)
    cameras = {
        "thin_lens": thin,
        "distortion": thin.replace(**{"lens.distortion": DISTORTION}),
        "double_gauss": real,
        "dispersion": real.replace(**{"lens.dispersion": True}),
    }
    radius_m = cardinal_points(real.lens).entrance_radius * 1e-3
    parameters = {"width": size, "height": size, "aperture_radius": radius_m, "focus_distance": FOCUS_M}
    return {name: load_scene(SCENE, bands, parameters, camera) for name, camera in cameras.items()}


def double_gauss(camera: Camera, distance_mm: float) -> Camera:
    """The camera with a double Gauss whose focal length gives the same image size as the thin lens."""
    focal_length_mm = distance_mm
    for _ in range(20):  # converges by a factor f/focus, about 40, each time
        real = camera.replace(**{"lens.prescription": "double_gauss", "lens.focal_length_mm": focal_length_mm})
        focal_length_mm *= distance_mm / cardinal_points(real.lens).principal_distance(FOCUS_M)
    return real


def one_pass(scene: Scene, options: argparse.Namespace) -> Callable[[], Any]:
    """A task that renders one pass of all rows."""
    return lambda: scene.render(1, options.samples, (0, options.size))


if __name__ == "__main__":
    main()
