"""Measure the time of a 31-band render, compared with plain Mitsuba band by band, at equal error.

    python benchmarks/render_speed.py [--scenes S …] [--size 64] [--spp 1024] [--turns 3] [--quick] [--json]

Plain Mitsuba is used as in its manual: the scene is loaded with ``mi.load_file``, with a specfilm of one channel for
one band and the default sampler (independent); ``mi.render`` runs 31 times with different seeds. This package runs
``mitsuba_sensor.render`` of the cube, from the scene file to standard errors and render statistics. Scene, variant,
size and bands (400 to 710 nm in steps of 10 nm) are the same.

The error is the root mean square over pixels and bands, relative to the mean of the band, from two renders with
different seeds. A first pair of plain renders gives the number of samples for equal error. Then the two are timed
alternately. Their errors are printed and differ by some percent; ``at_equal_error`` corrects the difference with
error² × seconds. ``plain_error2_spp_over_first`` is 1 if error² is inversely proportional to the samples. Kernels are
compiled before; the first call, with the compilation that Dr.Jit has not cached, is reported separately. Times are wall
clock and processor seconds of all threads.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from timing import lines, ratio

import mitsuba_sensor as ms
from mitsuba_sensor.core.versions import machine
from mitsuba_sensor.render.variants import choose_variant, use

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("cornell_box", "still_life", "color_checker")
LOW_NM, HIGH_NM = 400.0, 710.0
CAMERA = ms.load_camera("konnik_table1").replace(
    **{"quantum_efficiency.wavelengths_nm": [LOW_NM, HIGH_NM], "quantum_efficiency.curves": {"mono": [0.6, 0.6]}}
)
EXPOSURE = ms.Exposure(0.1)
PILOT = 16
"""Samples per pixel of the first pair of plain renders."""

Render = Callable[[int], np.ndarray]
"""From a seed to (H, W, bands)."""


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES)
    parser.add_argument("--size", type=int, default=64, help="width and height in pixels (default 64)")
    parser.add_argument("--spp", type=int, default=1024, help="samples per pixel of this package (default 1024)")
    parser.add_argument("--bands", type=int, default=31, help="number of bands from 400 to 710 nm (default 31)")
    parser.add_argument("--turns", type=int, default=3, help="pairs of renders of each (default 3)")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a very small picture: a check of the script",
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.quick:
        options.scenes, options.size, options.spp, options.bands, options.turns = ("cornell_box",), 8, 32, 2, 1
    variant = choose_variant()
    use(variant)
    results: dict[str, Any] = {**machine(), "variant": variant.name}
    for scene in options.scenes:
        results[scene] = compared(scene, options)
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


def ours(scene: str, size: int, bands: int, spp: int) -> Render:
    """The render of this package."""
    arguments = {"parameters": {"width": size, "height": size}, "bandwidth_nm": (HIGH_NM - LOW_NM) / bands}
    arguments |= {"spp": spp, "spectral": "cube"}
    return lambda seed: ms.render(ROOT / "scenes" / f"{scene}.xml", CAMERA, EXPOSURE, seed=seed, **arguments).data


def plain(scene: str, size: int, bands: int, spp: int) -> Render:
    """One render per band with plain Mitsuba, divided by the width of the band."""
    mi, edges = use(choose_variant()), np.linspace(LOW_NM, HIGH_NM, bands + 1)

    def render(seed: int) -> np.ndarray:
        loaded = mi.load_file(str(ROOT / "scenes" / f"{scene}.xml"), width=str(size), height=str(size))
        images = [
            np.array(mi.render(loaded, sensor=sensor(mi, loaded, size, band), seed=1000 * seed + k, spp=spp))
            for k, band in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
        ]
        return np.stack([image.reshape(size, size) for image in images], axis=-1) / np.diff(edges)

    return render


def sensor(mi: Any, loaded: Any, size: int, band: tuple[float, float]) -> Any:
    """The sensor of the scene, with a film for one band and the default sampler."""
    old = loaded.sensors()[0]
    parameters = mi.traverse(old)
    to_world = mi.ScalarTransform4f(np.array(old.world_transform().matrix).reshape(4, 4))
    settings: dict[str, Any] = {"type": "orthographic", "to_world": to_world}
    if "x_fov" in parameters:
        settings |= {"type": "perspective", "fov": float(np.ravel(parameters["x_fov"])[0])}
    if "aperture_radius" in parameters:
        lens = {name: float(np.ravel(parameters[name])[0]) for name in ("aperture_radius", "focus_distance")}
        settings |= {"type": "thinlens", **lens}
    if "near_clip" in parameters:
        settings |= {name: float(np.ravel(parameters[name])[0]) for name in ("near_clip", "far_clip")}
    box = {"type": "regular", "wavelength_min": band[0], "wavelength_max": band[1], "values": "1, 1"}
    film = {"type": "specfilm", "width": size, "height": size, "component_format": "float32", "band": box}
    return mi.load_dict({**settings, "film": {**film, "rfilter": {"type": "box"}}, "sampler": {"type": "independent"}})


def compared(scene: str, options: argparse.Namespace) -> dict[str, Any]:
    """Samples for equal error, times of alternating runs, and the measured errors."""
    mine, seconds = ours(scene, options.size, options.bands, options.spp), {}
    target, seconds["ours"] = pilot(mine)
    base, seconds["plain"] = pilot(plain(scene, options.size, options.bands, PILOT))
    spp = max(round(PILOT * base / target), 1)
    both = {"plain": plain(scene, options.size, options.bands, spp), "ours": mine}
    for render in both.values():  # compile for this number of samples
        render(0)
    wall: dict[str, list[float]] = {name: [] for name in both}
    processor: dict[str, list[float]] = {name: [] for name in both}
    squares: dict[str, list[float]] = {name: [] for name in both}
    for turn in range(options.turns):
        for name, render in both.items():
            start, started = time.perf_counter(), time.process_time()
            pair = [render(seed) for seed in (2 * turn + 11, 2 * turn + 12)]
            wall[name].append((time.perf_counter() - start) / 2)
            processor[name].append((time.process_time() - started) / 2)
            squares[name].append(squared_error(*pair))
    error = {name: math.sqrt(np.mean(those)) for name, those in squares.items()}
    correction = (error["plain"] / error["ours"]) ** 2
    return {
        **{f"{name}_spp": samples for name, samples in (("plain", spp), ("ours", options.spp))},
        **{f"{name}_error": value for name, value in error.items()},
        **{f"{name}_s": statistics.median(those) for name, those in wall.items()},
        "times_faster": ratio(wall["plain"], wall["ours"]),
        "times_fewer_processor_s": ratio(processor["plain"], processor["ours"]),
        "times_fewer_processor_s_at_equal_error": ratio(processor["plain"], processor["ours"]) * correction,
        "plain_error2_spp_over_first": error["plain"] ** 2 * spp / (base * PILOT),
        **{f"{name}_first_call_s": value for name, value in seconds.items()},
    }


def pilot(render: Render) -> tuple[float, float]:
    """Relative squared error, and seconds of the first call."""
    start = time.perf_counter()
    first = render(1)
    seconds = time.perf_counter() - start
    return squared_error(first, render(2)), seconds


def squared_error(one: np.ndarray, other: np.ndarray) -> float:
    """Squared error of one of two renders, relative to the mean of each band: mean over pixels and bands."""
    mean = 0.5 * (one + other).mean(axis=(0, 1), dtype=np.float64)
    return float(np.mean(0.5 * (one.astype(np.float64) - other) ** 2 / mean**2))


if __name__ == "__main__":
    main()
