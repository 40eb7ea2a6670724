"""Compare samplers and numbers of samples per pass: error of a render at equal processor time.

    python benchmarks/render_passes.py [--size 64] [--spp 64] [--turns 1] [--scenes S …] [--modes cube single]
                                [--samplers S …] [--samples N …] [--quick] [--json]

Every setting has about the same number of samples per pixel, in passes of 1 to 256 samples, with the renderer of this
package. Loading the scene and compiling kernels are not included. If a sampler rounds its sample count up, the rounded
count is used. Two renders with different seeds differ by √2 times their error. The error is relative to the mean of the
band: root mean square over pixels and bands (``error``); from the median of the squares, which a few bright samples do
not change (``typical``); and root mean square of the detected electrons (``electrons``). The cost is error² × processor
seconds of all threads, which depend little on other load. The table shows it relative to multijitter with 16 samples:
below 1 is better.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_sensor as ms
from mitsuba_sensor.core.versions import machine
from mitsuba_sensor.render.passes.passes import SAMPLER
from mitsuba_sensor.render.passes.prepared import PreparedRender, prepare
from mitsuba_sensor.render.passes.stop_criterion import PASS_SPP, StopCriterion
from mitsuba_sensor.render.variants import choose_variant, use

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("cornell_box", "still_life", "color_checker")
MODES = {"cube": {"spectral": "auto"}, "single": {"wavelength_nm": 550.0}}
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
SAMPLES = (1, 4, 16, 64, 256)
CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
BAND_NM = (400.0, 710.0)
"""31 bands of 10 nm."""
MEDIAN_OF_SQUARE = 0.4549
"""Median of the square of a normal deviate (χ² with one degree of freedom)."""
TARGET = 0.01


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help="width and height in pixels (default 64)")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel, total (default 64)")
    parser.add_argument("--turns", type=int, default=1, help="pairs of renders of each setting (default 1)")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES)
    parser.add_argument("--modes", nargs="+", default=tuple(MODES), choices=MODES)
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS, choices=SAMPLERS)
    parser.add_argument("--samples", type=int, nargs="+", default=SAMPLES, help="samples per pixel of a pass")
    parser.add_argument("--quick", action="store_true", help="a very small picture: a check of the script")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if options.quick:
        options.size, options.spp, options.scenes, options.modes = 8, 16, ("cornell_box",), ("single",)
        options.samplers, options.samples = ("independent", "multijitter"), (4, 16)
    mi = use(choose_variant())
    mi.set_log_level(mi.LogLevel.Error)  # no message for every sample count that is rounded up
    rows = [row for scene in options.scenes for mode in options.modes for row in compared(scene, mode, options)]
    print(json.dumps({**machine(), "rows": rows})) if options.json else show(rows)


class PassSetting:
    """One sampler and number of samples per pass; the sampler is already set in the job."""

    def __init__(self, job: PreparedRender, sampler: str, samples: int, spp: int) -> None:
        film_sampler = job.scene.sensor.sampler()
        film_sampler.set_sample_count(samples)
        self.job, self.sampler, self.samples = job, sampler, int(film_sampler.sample_count())
        self.passes = max(spp // self.samples, 1)
        self.seconds: list[float] = []
        self.squares: list[tuple[float, ...]] = []

    def render(self, seed: int, passes: int) -> tuple[np.ndarray, np.ndarray]:
        """Means over the passes: every band, (H, W, B), and the electrons, (H, W)."""
        self.job.renderer.run(seed, StopCriterion(passes, self.samples), lambda step: None)
        return np.concatenate([strip.bands.mean for strip in self.job.renderer.strips]), self.job.renderer.electrons()[
            0
        ]

    def turn(self, number: int) -> None:
        """Time a pair of renders and record the difference."""
        start = time.process_time()
        one, other = (self.render(2 * number + k, self.passes) for k in (1, 2))
        self.seconds.append((time.process_time() - start) / 2)
        self.squares.append((*squared(one[0], other[0]), squared(one[1][..., None], other[1][..., None])[0]))

    def row(self) -> dict[str, Any]:
        """The measured values, and the cost [s] of reaching TARGET by each definition of the error."""
        seconds, squares = statistics.median(self.seconds), np.mean(self.squares, axis=0)
        measures = ("error", "typical", "electrons")
        return {
            "sampler": self.sampler,
            "samples": self.samples,
            "passes": self.passes,
            "seconds": seconds,
            **{name: float(math.sqrt(square)) for name, square in zip(measures, squares, strict=True)},
            **{f"{name}_cost_s": float(s * seconds / TARGET**2) for name, s in zip(measures, squares, strict=True)},
        }


def squared(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Relative squared error of one render: mean over pixels and bands, and derived from the median."""
    middle = 0.5 * (one + other)
    square, lit = 0.5 * (one - other) ** 2, middle > 0
    typical = np.median(square[lit] / middle[lit] ** 2) / MEDIAN_OF_SQUARE
    return float(np.mean(square / middle.mean(axis=(0, 1)) ** 2)), float(typical)


def loaded(scene: str, mode: str, sampler: str, size: int) -> PreparedRender:
    """A render job with this sampler."""
    options = {"parameters": {"width": size, "height": size}, **MODES[mode]}
    return prepare(ROOT / "scenes" / f"{scene}.xml", camera(), EXPOSURE, sampler=sampler, **options)


def camera() -> ms.Camera:
    """The camera of Table 1 with constant QE over 31 bands."""
    return CAMERA.replace(
        **{"quantum_efficiency.wavelengths_nm": list(BAND_NM), "quantum_efficiency.curves": {"mono": [0.6, 0.6]}}
    )


def compared(scene: str, mode: str, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """All settings of one scene and mode, run alternately."""
    settings: dict[tuple[str, int], PassSetting] = {}
    for sampler in options.samplers:
        job = loaded(scene, mode, sampler, options.size)
        for samples in options.samples:
            setting = PassSetting(job, sampler, samples, options.spp)
            settings.setdefault((sampler, setting.samples), setting)
    for setting in [*settings.values()] * 2:  # compiles; a second time after the first change of setting
        setting.render(0, 1)
    for number in range(options.turns):
        for setting in settings.values():
            setting.turn(number)
    rows = [setting.row() for setting in settings.values()]
    ours = next((r for r in rows if (r["sampler"], r["samples"]) == (SAMPLER, PASS_SPP)), rows[0])
    for row in rows:
        ratios = {
            name.removesuffix("_s") + "_ratio": row[name] / ours[name] for name in row if name.endswith("_cost_s")
        }
        yield {"scene": scene, "mode": mode, **row, **ratios}


def show(rows: list[dict[str, Any]]) -> None:
    """Print a table; lower cost is better."""
    print(
        f"{'scene':<14}{'mode':<8}{'sampler':<13}{'n':>4}{'passes':>7}{'ms/pass':>9}{'error':>9}{'typical':>9}"
        f"{'cost: error':>13}{'typical':>9}{'electrons':>11}"
    )
    for r in rows:
        print(
            f"{r['scene']:<14}{r['mode']:<8}{r['sampler']:<13}{r['samples']:>4}{r['passes']:>7}"
            f"{1e3 * r['seconds'] / r['passes']:>9.1f}{r['error']:>9.2%}{r['typical']:>9.2%}"
            f"{r['error_cost_ratio']:>13.2f}{r['typical_cost_ratio']:>9.2f}{r['electrons_cost_ratio']:>11.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
