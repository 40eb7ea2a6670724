"""Measure what samples where they count would gain: tiles above the sensor's noise get more of them, the others none.

    python benchmarks/adaptive.py [--scenes FILE.xml …] [--most 4096] [--tile 8] [--width 96] [--by bars error] [--json]

Scene, exposure and ratio are those of benchmarks/denoise.py. From 128 samples per pixel on, the tenth of the tiles with
the largest ratio gets twice its samples, again and again, until 95 % of the pixels below the full well have a ratio of
1 or half of --most, the samples that a pixel can have, is used up; every time all is denoised anew. By bars: the tiles
are chosen as a render could choose them, by the error bars. By error: by their distance from the reference, which no
render knows. Cutting a render into tiles is taken to cost nothing.

gain : samples of a uniform render over those of this one with as many pixels below a ratio of 1.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from denoise import CAMERA, MEDIAN_E, PILOT_SPP, SCENES, made
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.render.denoise.denoise import Halves, denoise
from mitsuba_sensor.render.denoise.guides import Guides
from mitsuba_sensor.render.passes.passes import hashed_seed
from mitsuba_sensor.render.passes.prepared import prepare
from mitsuba_sensor.render.passes.renderer import Renderer
from mitsuba_sensor.render.passes.row_strip import Kept
from mitsuba_sensor.render.passes.stop_criterion import StopCriterion

Array = NDArray[np.float64]
Row = dict[str, Any]

SPP = 16
"""Samples per pixel and pass."""

FIRST = 8
"""Passes of the whole picture before tiles are chosen."""

SHARE, AT_ONCE, WANTED = 0.95, 0.1, 90
"""Pixels that shall have a ratio of 1; tiles that get more at a time; percentile of the ratio in a tile."""


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    shipped = [SCENES / f"{name}.xml" for name in ("cornell_box", "still_life")]
    parser.add_argument("--scenes", type=Path, nargs="+", default=shipped)
    parser.add_argument("--most", type=int, default=4096, help="samples of a pixel at most")
    parser.add_argument("--reference", type=int, default=16384, help="samples per pixel of the reference")
    parser.add_argument("--tile", type=int, default=8, help="rows and columns of a tile")
    parser.add_argument("--width", type=int, default=96, help="columns of the pictures")
    parser.add_argument("--by", nargs="+", choices=("bars", "error"), default=("bars", "error"))
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    rows = [row for scene in options.scenes for row in of_scene(scene, options)]
    if options.json:
        print(json.dumps(rows))
        return
    for row in rows:
        uniform = "more than all" if row["uniform_spp"] is None else f"{row['uniform_spp']:.0f}"
        print(
            f"{row['scene']}, by {row['by']}: ratio 1 in {row['share']:.1%} of the pixels with {row['spp']:.0f} "
            f"samples on average, uniformly with {uniform}: gain {row['gain']:.2f}; 95 % {row['p95']:.3g}, "
            f"mean {row['mean']:.3g}"
        )


class Passes:
    """Passes of one scene, from which renders of any samples per tile are put together.

    sums : (passes + 1, H, W) running sums of the photoelectrons of the even and of the odd passes, and of all squares.
    """

    def __init__(self, scene: Path, options: argparse.Namespace) -> None:
        job = prepare(scene, CAMERA, ms.Exposure(1.0), wavelength_nm=550, width=options.width)
        _, pilot, _ = made(job, PILOT_SPP, 0, denoise=False)
        job = replace(job, exposure=ms.Exposure(MEDIAN_E / float(np.median(pilot))))
        _, self.expected, _ = made(job, options.reference, 10**6, denoise=False)
        renderer, so_far = Renderer(job.scene, job.camera, job.exposure, job.bands, Kept.SPREAD | Kept.HALVES), []

        def remember(*_: object) -> float:
            so_far.append(renderer.passes * np.concatenate([strip.electrons.mean for strip in renderer.strips])[..., 0])
            return 1.0

        one_by_one = StopCriterion(options.most // SPP, SPP, goal=1e-9)
        renderer.run(hashed_seed(5, 0, 0), one_by_one, lambda _: None, remember)
        renderer.denoise()
        guides = renderer._guides
        assert guides is not None, "this needs a variant that traces guides"
        self.guides: Guides = guides
        passes = np.diff(so_far, axis=0, prepend=0.0)
        even = (np.arange(len(passes)) % 2 == 0)[:, None, None]
        self.sums = [_running(one) for one in (passes * even, passes * ~even, passes**2)]
        self.below = (self.expected > 0) & (self.expected < CAMERA.pixel.full_well_e)

    def denoised(self, count: NDArray[np.intp]) -> tuple[Array, Array]:
        """Denoised electrons and their expected squared error, with so many passes (even) in each pixel."""
        even, odd, squares = (np.take_along_axis(one, count[None], axis=0)[0] for one in self.sums)
        mean = (even + odd) / count
        variance = (squares / count - mean**2) / (count - 1)
        first, second = ((2 * x / count)[..., None] for x in (even, odd))
        halves = Halves(lambda: first, lambda: second, lambda _: variance, 0.5)
        found = denoise(halves, self.guides)
        return found.mean[..., 0], found.variance[..., 0]

    def ratio(self, mean: Array) -> Array:
        """(H, W) squared error over the electrons, 0 where it does not count."""
        return np.where(self.below, (mean - self.expected) ** 2 / np.maximum(self.expected, 1e-30), 0.0)

    def figures(self, count: NDArray[np.intp], mean: Array) -> dict[str, float]:
        """Samples per pixel on average, and what they reach."""
        ratio = self.ratio(mean)[self.below]
        shares = {
            "share": float((ratio < 1).mean()),
            "p95": float(np.percentile(ratio, 95)),
            "mean": float(ratio.mean()),
        }
        return {"spp": float(count.mean()) * SPP, **shares}


def of_scene(scene: Path, options: argparse.Namespace) -> list[Row]:
    """One row for each way to choose the tiles."""
    passes, most = Passes(scene, options), options.most // SPP
    uniform, count = [], FIRST
    while count <= most:
        even = np.full(passes.expected.shape, count)
        uniform.append(passes.figures(even, passes.denoised(even)[0]))
        count *= 2
    rows = []
    for by in options.by:
        found = adapted(passes, by, options.tile, most)
        alike = _samples_for(found["share"], uniform)
        gain = (uniform[-1]["spp"] if alike is None else alike) / found["spp"]
        rows.append({"scene": scene.stem, "by": by, **found, "uniform_spp": alike, "gain": gain})
    return rows


def adapted(passes: Passes, by: str, tile: int, most: int) -> dict[str, float]:
    """Figures of the render whose samples went where the error was."""
    rows, columns = passes.expected.shape
    place = (np.arange(rows) // tile)[:, None] * -(-columns // tile) + np.arange(columns) // tile  # number of its tile
    of_tiles = np.full(place.max() + 1, FIRST)
    while True:
        count = of_tiles[place]
        mean, variance = passes.denoised(count)
        found = passes.figures(count, mean)
        ratio = passes.ratio(mean) if by == "error" else variance / np.maximum(mean, 1.0)
        ratio = np.where(mean < CAMERA.pixel.full_well_e, ratio, 0.0)
        worst = np.array([np.percentile(ratio[place == number], WANTED) for number in range(of_tiles.size)])
        worst[of_tiles >= most] = 0.0
        chosen = np.argsort(worst)[-max(int(AT_ONCE * worst.size), 1) :]
        chosen = chosen[worst[chosen] > 0]
        if found["share"] >= SHARE or not chosen.size or found["spp"] > 0.5 * most * SPP:
            return found
        of_tiles[chosen] = np.minimum(2 * of_tiles[chosen], most)


def _samples_for(share: float, uniform: list[dict[str, float]]) -> float | None:
    """Samples of the uniform render with so many pixels below a ratio of 1; None: more than were made."""
    shares, spp = ([one[name] for one in uniform] for name in ("share", "spp"))
    return float(np.exp(np.interp(share, shares, np.log(spp)))) if share <= shares[-1] else None


def _running(values: Array) -> Array:
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


if __name__ == "__main__":
    main()
